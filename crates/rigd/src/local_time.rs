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

    /// `TZ` and the link of the system name a zone of this database.
    #[test]
    fn a_zone_is_found_by_its_name_in_the_database_of_the_system() {
        let rule = "CET-1CEST,M3.5.0,M10.5.0/3";
        // Version 2 of TZif (RFC 8536): one type of local time in each block, and the rule behind them.
        let mut block = b"TZif2".to_vec();
        block.extend([0; 15]);
        for count in [0_u32, 0, 0, 0, 1, 4] {
            block.extend(count.to_be_bytes());
        }
        block.extend([0; 6]);
        block.extend(b"CET\0");
        let database = tempfile::TempDir::new().unwrap();
        let zone = [&*block, &*block, b"\n", rule.as_bytes(), b"\n"].concat();
        std::fs::create_dir(database.path().join("Europe")).unwrap();
        std::fs::write(database.path().join("Europe/Laboratory"), zone).unwrap();
        let database = jiff::tz::TimeZoneDatabase::from_dir(database.path()).unwrap();
        let zone = database.get("Europe/Laboratory").unwrap();
        assert_eq!(in_zone("2026-07-31T22:30:00Z", zone), "2026-08-01 00:30 +02:00");
    }
}
