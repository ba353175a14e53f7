//! Verdicts over many benches, whose scatter the charts are not told.

use rig_model::random::Stream;

use super::{readings::Measured, *};
use crate::control::{BASELINE, COMPARED};

/// The standard deviations of a bench from check to check, in the order of [`Quantity::ALL`] but for the ratio.
const SCATTER: [f64; 6] = [0.05, 0.004, 0.003, 0.005, 0.02, 0.015];

/// A check of a bench that has changed by so many standard deviations in each quantity.
fn check(stream: &mut Stream, changes: [f64; 6]) -> CheckValues {
    let mut draw = |index: usize| SCATTER[index] * (stream.normal() + changes[index]);
    let values = [
        140.4 + draw(0),
        10.0 + draw(1),
        2.1 + draw(2),
        0.6 + draw(3),
        1.8 + draw(4),
        4.4 + draw(5),
    ];
    let ratio = values[5] - values[4];
    let [a, b, c, d, e, f] = values;
    CheckValues([a, b, c, d, e, f, ratio].map(|value| Measured { value, sigma: 0.0 }))
}

/// The verdicts of the checks after `before` checks of a bench, of which the last ones have a change.
fn verdicts(seed: u64, before: usize, changes: [f64; 6], after: usize) -> Vec<CheckVerdict> {
    let mut stream = Stream::new(seed, 152);
    let mut checks: Vec<_> = (0..before).map(|_| check(&mut stream, [0.0; 6])).collect();
    let next = |_| {
        checks.push(check(&mut stream, changes));
        judge(&checks).verdict
    };
    (0..after).map(next).collect()
}

fn change(index: usize, by: f64) -> [f64; 6] {
    let mut changes = [0.0; 6];
    changes[index] = by;
    changes
}

/// Shares of benches whose `n` checks after the change have a verdict, at least once.
fn share(before: usize, changes: [f64; 6], n: usize, is_meant: fn(CheckVerdict) -> bool) -> f64 {
    const BENCHES: u64 = 200;
    let found =
        (0..BENCHES).filter(|seed| verdicts(*seed, before, changes, n).into_iter().any(is_meant));
    found.count() as f64 / BENCHES as f64
}

/// `cargo test -p rig-commission shares_of_benches -- --nocapture` prints the table of docs/check-bench.md.
#[test]
fn shares_of_benches_with_a_change_are_told_and_few_without_one() {
    let is_told = |verdict| verdict != CheckVerdict::Accepted;
    let is_distrusted = |verdict| verdict == CheckVerdict::NotToBeTrusted;
    println!("checks before, change in standard deviations, checks after: told, not to be trusted");
    for (before, by, after, told, distrusted) in [
        (BASELINE, 0.0, 30, 0.05..0.2, 0.0..0.03),
        (COMPARED, 0.0, 30, 0.05..0.2, 0.0..0.03),
        (COMPARED, 1.0, 20, 0.5..0.85, 0.15..0.45),
        (COMPARED, 3.0, 3, 0.5..0.75, 0.15..0.4),
        (COMPARED, 5.0, 2, 0.95..1.01, 0.7..0.9),
        (BASELINE, 5.0, 2, 0.3..0.55, 0.25..0.5),
        (BASELINE, 10.0, 1, 0.9..1.01, 0.1..0.4),
        (COMPARED, 10.0, 1, 0.98..1.01, 0.98..1.01),
    ] {
        let changes = change(3, by);
        let shares =
            [share(before, changes, after, is_told), share(before, changes, after, is_distrusted)];
        println!("{before:3} {by:4} {after:3}: {:.3} {:.3}", shares[0], shares[1]);
        assert!(told.contains(&shares[0]) && distrusted.contains(&shares[1]), "{before}, {by}");
    }
}

#[test]
fn a_bench_without_enough_checks_is_looked_at_and_an_alarm_names_its_quantity() {
    let mut stream = Stream::new(1, 153);
    let mut checks = Vec::new();
    for number in 1..=BASELINE + 1 {
        checks.push(check(&mut stream, [0.0; 6]));
        let judged = judge(&checks);
        let expected = if number > BASELINE { CheckVerdict::Accepted } else { CheckVerdict::Look };
        assert_eq!(judged.verdict, expected, "{number}: {judged:?}");
    }
    checks.push(check(&mut stream, change(1, 12.0)));
    let judged = judge(&checks);
    assert_eq!(judged.verdict, CheckVerdict::NotToBeTrusted);
    let named: Vec<_> = judged.alarms.iter().map(|alarm| alarm.quantity).collect();
    assert_eq!(named, [Quantity::Surface]);
    assert!(judged.reason().unwrap().starts_with("surface of the level block: score "));
}

#[test]
fn the_quantities_are_those_of_the_touches_and_a_missing_part_is_named() {
    let block = |tilt_deg, height_mm| BlockHeight { tilt_deg, height_mm };
    let readings = Readings {
        free_hz: vec![140.4, 140.6],
        block: vec![block(0.0, 10.0), block(0.0, 10.002), block(45.0, 11.5), block(-45.01, 12.1)],
        references_hz: [vec![6.0], vec![80.0, 82.0]],
    };
    let values = readings.values().unwrap();
    let expected =
        [140.5, 10.001, 11.8 - 10.001, -0.6, 6.0_f64.ln(), 0.5 * (80.0_f64.ln() + 82.0_f64.ln())];
    for (quantity, expected) in Quantity::ALL.into_iter().zip(expected) {
        assert!((values.get(quantity) - expected).abs() < 1e-9, "{quantity:?}");
    }
    let ratio = values.get(Quantity::ReferenceRatio);
    assert!((ratio - (expected[5] - expected[4])).abs() < 1e-9);
    let without = Readings { references_hz: [vec![-0.1], vec![80.0]], ..readings };
    let missing = without.values().unwrap_err().to_string();
    assert_eq!(missing, "the first reference sample was not measured");
}
