//! Times as the clock on the wall of the laboratory shows them.

use jiff::{Timestamp, tz::TimeZone};

/// A time of the journal (UTC, RFC 3339) in the time zone of this computer: `2026-11-22 19:49 +01:00`.
/// Unchanged if it is no such time.
pub(crate) fn local(utc: &str) -> String {
    in_zone(utc, TimeZone::system())
}

fn in_zone(utc: &str, zone: TimeZone) -> String {
    let Ok(time) = utc.parse::<Timestamp>() else { return utc.to_owned() };
    time.to_zoned(zone).strftime("%Y-%m-%d %H:%M %:z").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_has_the_offset_of_its_day() {
        let zone = || TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").unwrap();
        for (utc, local) in [
            ("2026-11-22T18:49:03.005Z", "2026-11-22 19:49 +01:00"),
            ("2026-07-31T22:30:00Z", "2026-08-01 00:30 +02:00"),
            ("soon", "soon"),
        ] {
            assert_eq!(in_zone(utc, zone()), local);
        }
    }
}
