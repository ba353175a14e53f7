//! Positions and labels of ticks.

/// A tick of an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub(crate) value: f64,
    /// The label; `None` for a minor tick.
    pub(crate) text: Option<String>,
}

/// Ticks at the given values within the range, each with its name or its value.
pub(super) fn given(ticks: &[(f64, Option<String>)], from: f64, to: f64) -> Vec<Tick> {
    let shown = ticks.iter().filter(|(value, _)| from <= *value && *value <= to);
    let text = |value: f64, name: &Option<String>| {
        name.clone().unwrap_or_else(|| with_minus(&value.to_string()))
    };
    shown.map(|(value, name)| Tick { value: *value, text: Some(text(*value, name)) }).collect()
}

/// At most about `room` ticks, at multiples of 1, 2 or 5 times a power of ten.
pub(super) fn linear(from: f64, to: f64, room: f64) -> Vec<Tick> {
    let most = room.clamp(2.0, 12.0);
    let least_step = (to - from) / most;
    let power = least_step.log10().floor();
    let magnitude = 10.0_f64.powf(power);
    // A step of ten times the magnitude is large enough in any case.
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * magnitude)
        .find(|&step| step >= least_step * (1.0 - 1e-9))
        .unwrap_or(10.0 * magnitude);
    let decimals = decimals_of(step);
    let (first, last) = ((from / step - 1e-9).ceil(), (to / step + 1e-9).floor());
    let mut ticks = Vec::new();
    let mut count = first;
    // Twelve steps at most, by the choice of the step.
    while count <= last {
        // Adding zero turns minus zero into zero.
        let value = count * step + 0.0;
        ticks.push(Tick { value, text: Some(with_minus(&format!("{value:.decimals$}"))) });
        count += 1.0;
    }
    ticks
}

/// The number of decimals that distinguishes multiples of `step`.
fn decimals_of(step: f64) -> usize {
    (0..12)
        .find(|&decimals| {
            let scaled = step * 10.0_f64.powi(decimals);
            (scaled - scaled.round()).abs() < 1e-6 * scaled
        })
        .and_then(|decimals| usize::try_from(decimals).ok())
        .unwrap_or(12)
}

/// Ticks at powers of ten, about `room` of them labelled; over a few decades also at 2 and 5 times
/// the powers.
pub(super) fn log(from: f64, to: f64, room: f64) -> Vec<Tick> {
    let decades = (to / from).log10();
    let room = room.max(2.0);
    // Decades between labels.
    let stride = (decades / room).ceil().max(1.0);
    let written: &[f64] = if decades < 1.0 && room > 4.0 {
        &[1.0, 2.0, 3.0, 5.0]
    } else if decades < 2.5 {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    let mut ticks = Vec::new();
    let mut power = from.log10().floor();
    while power <= to.log10() {
        for multiple in 1..10 {
            let multiple = f64::from(multiple);
            let is_written = written.contains(&multiple) && power.rem_euclid(stride) == 0.0;
            if is_written || decades < 6.0 {
                let value = multiple * 10.0_f64.powf(power);
                ticks.push(Tick { value, text: is_written.then(|| of_decades(value, power)) });
            }
        }
        power += 1.0;
    }
    ticks.retain(|tick| from <= tick.value && tick.value <= to);
    ticks
}

/// `0.02`, `500`, or `10⁻⁶` for numbers with many zeros.
fn of_decades(value: f64, power: f64) -> String {
    if (-3.0..=5.0).contains(&power) {
        let decimals = if power < 0.0 { (-power).round() } else { 0.0 };
        // Between 0 and 3.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let decimals = decimals as usize;
        return format!("{value:.decimals$}");
    }
    let superscript = |character: char| match character {
        '-' => '⁻',
        '0' => '⁰',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁴' as u32 + (digit as u32 - '4' as u32)).unwrap_or(digit),
    };
    let exponent: String = power.to_string().chars().map(superscript).collect();
    let multiple = value / 10.0_f64.powf(power);
    if (multiple - 1.0).abs() < 1e-6 {
        format!("10{exponent}")
    } else {
        format!("{multiple:.0}·10{exponent}")
    }
}

/// The text with a typographic minus sign.
fn with_minus(text: &str) -> String {
    text.replacen('-', "−", 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(ticks: &[Tick], expected: &[&str]) {
        let texts: Vec<_> = ticks.iter().filter_map(|tick| tick.text.as_deref()).collect();
        assert_eq!(texts, expected);
    }

    #[test]
    fn steps_are_round_and_decimals_no_more_than_needed() {
        check(&linear(0.0, 100.0, 6.0), &["0", "20", "40", "60", "80", "100"]);
        check(&linear(-0.3, 0.3, 6.0), &["−0.3", "−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3"]);
        check(&linear(140.31, 140.42, 4.0), &["140.35", "140.40"]);
        check(&linear(0.0, 1e6, 2.0), &["0", "500000", "1000000"]);
    }

    #[test]
    fn given_ticks_have_their_names_or_their_values() {
        let ticks = [(-1.5, None), (2.0, Some("T1".to_owned())), (9.0, None)];
        check(&given(&ticks, -2.0, 3.0), &["−1.5", "T1"]);
    }

    #[test]
    fn decades_are_written_in_digits_while_these_can_be_read() {
        check(&log(0.009, 110.0, 6.0), &["0.01", "0.1", "1", "10", "100"]);
        check(&log(0.9, 30.0, 6.0), &["1", "2", "5", "10", "20"]);
        check(&log(1e-7, 1e6, 6.0), &["10⁻⁶", "0.001", "1", "1000", "10⁶"]);
        check(&log(2e-9, 9e-9, 6.0), &["2·10⁻⁹", "3·10⁻⁹", "5·10⁻⁹"]);
    }
}
