//! Times as they are in journals.

/// Milliseconds since 1970 of a time such as `2026-11-22T08:15:30.250Z`.
pub(crate) fn unix_ms(text: &str) -> Option<i64> {
    let shape = b"dddd-dd-ddTdd:dd:dd.dddZ";
    let fits = |(byte, shape): (u8, &u8)| match shape {
        b'd' => byte.is_ascii_digit(),
        other => byte == *other,
    };
    if text.len() != shape.len() || !text.bytes().zip(shape).all(fits) {
        return None;
    }
    let number = |from: usize, to: usize| text[from..to].parse::<i64>().ok();
    let (year, month, day) = (number(0, 4)?, number(5, 7)?, number(8, 10)?);
    let of_day = (number(11, 13)? * 60 + number(14, 16)?) * 60 + number(17, 19)?;
    if !(1..=12).contains(&month) {
        return None;
    }
    // Years that begin in March: the leap day is the last of its year, and every five months have 153 days.
    let year = if month > 2 { year } else { year - 1 };
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let days = 365 * year + year / 4 - year / 100 + year / 400 + of_year - DAYS_TO_1970;
    Some((days * 86_400 + of_day) * 1000 + number(20, 23)?)
}

/// From the first of March of the year 0 to the first of January of 1970.
const DAYS_TO_1970: i64 = 719_468;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        // `date -u -d TIME +%s%3N` of GNU coreutils.
        for (text, ms) in [
            ("1970-01-01T00:00:00.000Z", 0),
            ("2000-02-29T23:59:59.999Z", 951_868_799_999),
            ("2026-11-25T15:36:01.250Z", 1_795_620_961_250),
            ("2100-03-01T00:00:00.000Z", 4_107_542_400_000),
        ] {
            assert_eq!(unix_ms(text), Some(ms), "{text}");
        }
        for wrong in ["", "2026-11-25", "2026-13-01T00:00:00.000Z", "2026-11-25T15:36:01.25é"] {
            assert_eq!(unix_ms(wrong), None, "{wrong}");
        }
    }
}
