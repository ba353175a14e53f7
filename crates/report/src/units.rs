//! Numbers as people read them.

/// A value with its standard deviation, to two digits of the latter: `140.403 ± 0.012`.
pub fn with_sigma(value: f64, sigma: f64) -> String {
    let (value, sigma) = value_and_sigma(value, sigma);
    format!("{value} ± {sigma}")
}

/// The two parts of [`with_sigma`].
pub(crate) fn value_and_sigma(value: f64, sigma: f64) -> (String, String) {
    let decimals = decimals_for(sigma);
    (fixed(value, decimals), fixed(sigma, decimals))
}

/// A value with this many decimals and a true minus sign.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.chars().all(|digit| matches!(digit, '-' | '0' | '.'));
    if is_zero { text.replacen('-', "", 1) } else { text.replacen('-', "−", 1) }
}

/// The decimals that show two digits of a standard deviation.
pub(crate) fn decimals_for(sigma: f64) -> usize {
    (0..=6).find(|&decimals| sigma * 10.0_f64.powi(decimals) >= 9.5).map_or_else(
        || if sigma > 0.0 { 6 } else { 3 },
        |decimals| usize::try_from(decimals).unwrap_or(6),
    )
}

/// A share in percent: `92 %`, `94.1 %`.
pub(crate) fn percent(share: f64) -> String {
    let text = format!("{:.1}", share * 100.0);
    format!("{} %", text.strip_suffix(".0").unwrap_or(&text))
}

/// Two shares in whole percent: `81 % to 97 %`.
pub(crate) fn percent_range((low, high): (f64, f64)) -> String {
    format!("{:.0} % to {:.0} %", low * 100.0, high * 100.0)
}

/// A time: `3.2 s`, `4 min 07 s`, `2 h 05 min`.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let minutes = (seconds / 60.0).floor();
    let rest = (seconds - 60.0 * minutes).floor();
    if minutes < 60.0 {
        return format!("{minutes:.0} min {rest:02.0} s");
    }
    let hours = (minutes / 60.0).floor();
    format!("{hours:.0} h {:02.0} min", minutes - 60.0 * hours)
}

/// A time into the run: `0:04:07.3`.
pub(crate) fn clock(seconds: f64) -> String {
    let tenths = (seconds * 10.0).round();
    let (hours, rest) = ((tenths / 36_000.0).floor(), tenths.rem_euclid(36_000.0));
    let (minutes, rest) = ((rest / 600.0).floor(), rest.rem_euclid(600.0));
    format!("{hours:.0}:{minutes:02.0}:{:04.1}", rest / 10.0)
}

/// Milliseconds since 1970 of a time of the journal: UTC, RFC 3339 with milliseconds, such as
/// `2026-11-22T18:04:00.250Z`. `None` for another form.
pub(crate) fn unix_ms(text: &str) -> Option<i64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let parts = |text: &str, mark| -> Option<[i64; 3]> {
        let parts = text.split(mark).map(|part| part.parse().ok()).collect::<Option<Vec<i64>>>()?;
        parts.try_into().ok()
    };
    let [year, month, day] = parts(date, '-')?;
    let (time, ms) = time.split_once('.')?;
    let [hour, minute, second] = parts(time, ':')?;
    if ms.len() != 3 || !(1..=12).contains(&month) {
        return None;
    }
    // Years begin in March here, so that a leap day is the last day of its year.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    // 719 469 days before 1970 it was 1 March of the year 0; months have 30.6 days on average.
    let days = 365 * year + leap_days + (153 * month + 2) / 5 + day - 719_469;
    let seconds = ((days * 24 + hour) * 60 + minute) * 60 + second;
    Some(seconds * 1000 + ms.parse::<i64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_as_many_decimals_as_its_uncertainty_deserves() {
        #[track_caller]
        fn check(value: f64, sigma: f64, expected: &str) {
            assert_eq!(with_sigma(value, sigma), expected);
        }
        check(140.40312, 0.0123, "140.403 ± 0.012");
        check(140.40312, 0.0996, "140.40 ± 0.10");
        check(-0.004, 0.021, "−0.004 ± 0.021");
        check(-0.0004, 0.21, "0.00 ± 0.21");
        check(133.7, 2.34, "133.7 ± 2.3");
        check(133.7, 23.4, "134 ± 23");
        check(5.0, 0.0, "5.000 ± 0.000");
    }

    #[test]
    fn times_are_written_as_people_say_them() {
        let written = [0.0, 3.25, 59.96, 60.0, 247.9, 3599.9, 7500.0].map(duration);
        assert_eq!(
            written,
            [
                "0.0 s",
                "3.2 s",
                "0 min 59 s",
                "1 min 00 s",
                "4 min 07 s",
                "59 min 59 s",
                "2 h 05 min"
            ]
        );
        assert_eq!([0.0, 247.34, 3600.0].map(clock), ["0:00:00.0", "0:04:07.3", "1:00:00.0"]);
        assert_eq!([0.92, 0.941, 1.0].map(percent), ["92 %", "94.1 %", "100 %"]);
        assert_eq!(percent_range((0.8116, 0.9684)), "81 % to 97 %");
    }

    #[test]
    fn a_time_of_the_journal_counts_from_1970() {
        let read = |text| unix_ms(text);
        assert_eq!(read("1970-01-01T00:00:00.000Z"), Some(0));
        assert_eq!(read("1969-12-31T23:59:59.999Z"), Some(-1));
        assert_eq!(read("2024-02-29T12:00:00.000Z"), Some(1_709_208_000_000));
        assert_eq!(read("2026-11-21T08:15:42.120Z"), Some(1_795_248_942_120));
        assert_eq!(read("2000-03-01T00:00:00.007Z"), Some(951_868_800_007));
        for other in ["", "2026-11-21", "2026-11-21T08:15:42Z", "2026-13-21T08:15:42.120Z"] {
            assert_eq!(read(other), None, "{other}");
        }
    }
}
