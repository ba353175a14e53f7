//! When a certificate expires: the one field of X.509 that rigd reads.

use jiff::{Timestamp, civil::DateTime, tz::TimeZone};

/// Tags of DER.
const SEQUENCE: u8 = 0x30;
const UTC_TIME: u8 = 0x17;
const GENERALIZED_TIME: u8 = 0x18;
/// The version of a certificate, which the first version leaves out.
const VERSION: u8 = 0xA0;

/// The time after which a certificate in DER is no longer valid; `None` if it is none.
///
/// # Source
/// RFC 5280, section 4.1 (the fields and their order) and 4.1.2.5 (both forms of a time).
pub(super) fn expires(certificate: &[u8]) -> Option<Timestamp> {
    let (signed, _) = inside(certificate, SEQUENCE)?;
    let (mut fields, _) = inside(signed, SEQUENCE)?;
    if fields.first() == Some(&VERSION) {
        fields = element(fields)?.rest;
    }
    // Serial number, algorithm of the signature, issuer.
    for _ in 0..3 {
        fields = element(fields)?.rest;
    }
    let (validity, _) = inside(fields, SEQUENCE)?;
    let not_after = element(element(validity)?.rest)?;
    let text = str::from_utf8(not_after.content).ok()?;
    let text = match not_after.tag {
        GENERALIZED_TIME => text.to_owned(),
        // Years of two digits are those from 1950 to 2049.
        UTC_TIME => {
            let year: u32 = text.get(..2)?.parse().ok()?;
            format!("{}{text}", if year < 50 { "20" } else { "19" })
        }
        _ => return None,
    };
    let time = DateTime::strptime("%Y%m%d%H%M%SZ", &text).ok()?;
    Some(time.to_zoned(TimeZone::UTC).ok()?.timestamp())
}

struct Element<'a> {
    tag: u8,
    content: &'a [u8],
    rest: &'a [u8],
}

/// The first element of some bytes.
fn element(bytes: &[u8]) -> Option<Element<'_>> {
    let [tag, length, rest @ ..] = bytes else { return None };
    let (length, rest) = match length {
        short @ ..0x80 => (usize::from(*short), rest),
        0x80 => return None,
        // A certificate of more than 16 MB has more bytes in its length.
        long @ 0x81..=0x83 => {
            let (digits, rest) = rest.split_at_checked(usize::from(long - 0x80))?;
            (digits.iter().fold(0, |length, digit| length << 8 | usize::from(*digit)), rest)
        }
        _ => return None,
    };
    let (content, rest) = rest.split_at_checked(length)?;
    Some(Element { tag: *tag, content, rest })
}

/// The content of the first element, if it has this tag, and what follows it.
fn inside(bytes: &[u8], tag: u8) -> Option<(&[u8], &[u8])> {
    let found = element(bytes)?;
    (found.tag == tag).then_some((found.content, found.rest))
}

#[cfg(test)]
mod tests {
    use rcgen::{CertificateParams, KeyPair, date_time_ymd};

    use super::*;

    fn certificate(year: i32) -> Vec<u8> {
        let mut params = CertificateParams::new(vec!["bench".to_owned()]).unwrap();
        params.not_after = date_time_ymd(year, 3, 1);
        params.self_signed(&KeyPair::generate().unwrap()).unwrap().der().to_vec()
    }

    #[test]
    fn both_forms_of_a_time_are_read() {
        // `date -u -d 2027-03-01 +%s` and so on.
        for (year, unix_s) in [
            (1999, 920_246_400),
            (2027, 1_803_859_200),
            (2049, 2_498_169_600),
            (2051, 2_561_241_600),
        ] {
            let found = expires(&certificate(year)).unwrap();
            assert_eq!(found.as_second(), unix_s, "{year}");
        }
    }

    #[test]
    fn no_bytes_are_taken_for_a_certificate_by_chance_and_none_make_it_panic() {
        let whole = certificate(2027);
        for cut in 0..whole.len() {
            _ = expires(&whole[..cut]);
        }
        assert_eq!(expires(&whole[..100]), None);
        assert_eq!(expires(b""), None);
        assert_eq!(expires(b"-----BEGIN CERTIFICATE-----"), None);
    }
}
