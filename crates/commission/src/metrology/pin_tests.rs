//! Touches on pins on benches with screws that the fit does not assume.

use rig_model::random::Stream;

use super::{
    tests::{NOISE, Screw, Truth, even_tilts, touches, touches_at},
    *,
};
use crate::{Finding, Verdict, probe_radius::probe_radius};

const PIN_MM: f64 = 2.0;
const RIG_FILE_MM: f64 = 0.5;
/// Those of `config/protocols/pin.toml`.
const TILTS: [f64; 9] = [-45.0, -34.0, -23.0, -11.0, 0.0, 11.0, 23.0, 34.0, 45.0];

/// Touches of a pin whose top is near the probe at the height of the level block, three at each tilt. The height at which
/// the ball is as far from the axis of the pin as both radii is found by bisection.
fn touches_of_pin(
    truth: &Truth,
    (pin_mm, radius_mm): (f64, f64),
    chance: &mut Stream,
) -> Vec<PinTouch> {
    let [surface, from_axis, beside, zero] = truth.geometry;
    let axis = (
        beside + 0.2 * (2.0 * chance.uniform() - 1.0),
        from_axis - radius_mm - pin_mm + 0.1 * (2.0 * chance.uniform() - 1.0),
    );
    let touch = |tilt_deg: f64, chance: &mut Stream| {
        let at_deg = tilt_deg + NOISE.tilt_deg * chance.normal() + zero;
        let (sin, cos) = at_deg.to_radians().sin_cos();
        let axis = (axis.0 * cos + axis.1 * sin, axis.1 * cos - axis.0 * sin);
        let (mut low, mut high) = (axis.1, axis.1 + pin_mm + radius_mm);
        for _ in 0..60 {
            let centre = 0.5 * (low + high);
            let is_near = (beside - axis.0).hypot(centre - axis.1) < pin_mm + radius_mm;
            if is_near { low = centre } else { high = centre }
        }
        let true_mm = surface - from_axis + low;
        let height_mm = true_mm + truth.screw.error(true_mm) + NOISE.height_mm * chance.normal();
        PinTouch { tilt_deg, height_mm }
    };
    TILTS.map(|tilt| [tilt; 3]).concat().into_iter().map(|tilt| touch(tilt, chance)).collect()
}

/// What touches on blocks say, as their record has it.
fn prior(truth: &Truth, blocks: Blocks, chance: &mut Stream) -> PinPrior {
    let touches = match blocks {
        Blocks::One => touches(truth, &[0.0], chance),
        Blocks::Two => touches(truth, &[0.0, 10.0], chance),
        Blocks::OfScrew => touches_at(truth, &even_tilts(), &[0.0, -0.7], chance),
    };
    let found = fit(&touches, &NOISE, &[]).unwrap();
    let c = found.covariance;
    PinPrior {
        axis_mm: found.surface_mm - found.surface_and_radius_mm,
        probe_beside_pivot_mm: found.probe_beside_pivot_mm,
        covariance_mm2: [
            [c[0][0] + c[1][1] - 2.0 * c[0][1], c[0][2] - c[1][2]],
            [c[0][2] - c[1][2], c[2][2]],
        ],
    }
}

#[derive(Debug, Clone, Copy)]
enum Blocks {
    /// One block, 21 touches.
    One,
    /// A second one 10 mm higher.
    Two,
    /// The touches of `config/protocols/screw.toml`, on a second block that is 0.7 mm lower.
    OfScrew,
}

fn bench(seed: u64, screw: impl Fn(u64, &mut Stream) -> Screw) -> (Truth, f64, Stream) {
    let mut chance = Stream::new(seed, 166);
    let mut around = |middle: f64, width: f64| middle + width * (2.0 * chance.uniform() - 1.0);
    let geometry = [around(10.0, 0.5), around(4.5, 0.2), around(0.3, 0.5), around(0.0, 0.5)];
    let radius_mm = around(0.5, 0.03);
    let screw = screw(seed, &mut chance);
    (Truth { geometry, screw }, radius_mm, chance)
}

fn judged(touches: &[PinTouch], prior: &PinPrior, pin_mm: f64) -> Result<Finding, NoGeometry> {
    probe_radius(touches, &NOISE, prior, (pin_mm, RIG_FILE_MM))
}

/// Root mean square of the error, and of what is stated, µm; coverage of the 95 % intervals; share that is not refused.
fn campaign(blocks: Blocks, screw: impl Fn(u64, &mut Stream) -> Screw) -> [f64; 4] {
    let benches = if matches!(blocks, Blocks::OfScrew) { 40 } else { 60 };
    let (mut squares, mut stated, mut inside, mut known) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..benches {
        let (truth, radius_mm, mut chance) = bench(seed, &screw);
        let prior = prior(&truth, blocks, &mut chance);
        let touches = touches_of_pin(&truth, (PIN_MM, radius_mm), &mut chance);
        let finding = judged(&touches, &prior, PIN_MM).unwrap();
        let value = &finding.values[0];
        let (off, sigma) = (value.value - radius_mm, value.standard_uncertainty);
        squares += off.powi(2);
        stated += sigma.powi(2);
        inside += f64::from(u8::from(off.abs() < 1.96 * sigma));
        known += f64::from(u8::from(!matches!(finding.verdict, Verdict::Failed(_))));
    }
    let count = benches as f64;
    [1e3 * (squares / count).sqrt(), 1e3 * (stated / count).sqrt(), inside / count, known / count]
}

/// `cargo test -p rig-commission pin -- --nocapture` prints the table of `docs/commission.md`.
#[test]
fn stated_uncertainties_cover_the_radius_for_screws_that_the_fit_does_not_assume() {
    let none = |_: u64, _: &mut Stream| Screw::None;
    let periodic = |_: u64, chance: &mut Stream| {
        Screw::Periodic(0.01, 2.0, std::f64::consts::TAU * chance.uniform())
    };
    let fine = |seed: u64, _: &mut Stream| Screw::Broken(0.002, 0.3, seed);
    let broken = |seed: u64, _: &mut Stream| Screw::Broken(0.014, 0.3, seed);
    for blocks in [Blocks::One, Blocks::Two, Blocks::OfScrew] {
        let rows = [
            ("none", campaign(blocks, none)),
            ("kinks, 2 µm", campaign(blocks, fine)),
            ("periodic, 10 µm", campaign(blocks, periodic)),
            ("kinks, 14 µm", campaign(blocks, broken)),
        ];
        for (name, [rms_um, stated_um, inside, known]) in rows {
            println!(
                "{blocks:?}, {name}: {rms_um:.1} µm, stated {stated_um:.1} µm, within 95 % {inside:.2}, not refused {known:.2}"
            );
            assert!(inside >= 0.88, "{blocks:?}, {name}: {inside}");
            assert!(rms_um < 1.3 * stated_um, "{blocks:?}, {name}: {rms_um} of {stated_um} µm");
        }
    }
}

fn periodic(seed: u64) -> (Truth, f64, Stream) {
    bench(seed, |_, chance| Screw::Periodic(0.01, 2.0, std::f64::consts::TAU * chance.uniform()))
}

/// `cargo test -p rig-commission pin -- --nocapture` prints the counts.
#[test]
fn what_is_no_pin_is_refused_and_a_wrong_radius_of_it_is_seen_where_it_can_be() {
    let (mut flat, mut wrong, mut near) = (0, 0, 0);
    for seed in 0..20 {
        let (truth, _, mut chance) = periodic(seed);
        let prior = prior(&truth, Blocks::OfScrew, &mut chance);
        let on_block: Vec<PinTouch> = touches_at(&truth, &TILTS, &[0.0], &mut chance)
            .into_iter()
            .map(|BlockTouch { tilt_deg, height_mm, .. }| PinTouch { tilt_deg, height_mm })
            .collect();
        flat += u32::from(judged(&on_block, &prior, PIN_MM).is_err());
        let touches = touches_of_pin(&truth, (PIN_MM, RIG_FILE_MM), &mut chance);
        let of = |pin_mm: f64| judged(&touches, &prior, pin_mm).unwrap().verdict;
        wrong += u32::from(matches!(of(1.1 * PIN_MM), Verdict::Failed(_)));
        wrong += u32::from(matches!(of(0.9 * PIN_MM), Verdict::Failed(_)));
        // Three percent of the pin are twelve of the ball: as far as touches can tell, this is a ball of another radius.
        near += u32::from(matches!(of(1.03 * PIN_MM), Verdict::RigFile(_)));
    }
    println!(
        "a flat block is refused {flat} times of 20, 10 % {wrong} of 40; 3 % ask for a change {near} of 20"
    );
    assert_eq!((flat, wrong, near), (20, 40, 20));
}

#[test]
fn a_touch_of_the_pin_that_is_off_is_named() {
    for seed in 0..20 {
        let (truth, radius_mm, mut chance) = periodic(seed);
        let prior = prior(&truth, Blocks::OfScrew, &mut chance);
        let mut touches = touches_of_pin(&truth, (PIN_MM, radius_mm), &mut chance);
        let wrong = usize::try_from(seed).unwrap();
        touches[wrong].height_mm += 0.5;
        let refused = judged(&touches, &prior, PIN_MM).unwrap_err();
        let NoGeometry::Scattered { tilt_deg, height_mm, .. } = refused else {
            panic!("seed {seed}: {refused:?}")
        };
        let PinTouch { tilt_deg: expected_deg, height_mm: expected_mm } = touches[wrong];
        assert_eq!((tilt_deg, height_mm), (expected_deg, expected_mm), "seed {seed}");
    }
}

#[test]
fn without_blocks_the_radius_is_too_uncertain_and_the_uncertainty_covers_it() {
    let (mut inside, mut refused) = (0, 0);
    for seed in 0..40 {
        let (truth, radius_mm, mut chance) = periodic(seed);
        let [surface, from_axis, beside, _] = truth.geometry;
        let by_rule = PinPrior {
            axis_mm: surface - from_axis + 0.3 * chance.normal(),
            probe_beside_pivot_mm: beside + 0.2 * chance.normal(),
            covariance_mm2: [[0.09, 0.0], [0.0, 0.04]],
        };
        let touches = touches_of_pin(&truth, (PIN_MM, radius_mm), &mut chance);
        let finding = judged(&touches, &by_rule, PIN_MM).unwrap();
        let value = &finding.values[0];
        let off = (value.value - radius_mm).abs();
        inside += u32::from(off < 1.96 * value.standard_uncertainty);
        refused += u32::from(matches!(finding.verdict, Verdict::Failed(_)));
    }
    println!("by a rule: within 95 % {inside} of 40, refused {refused} of 40");
    assert!(inside >= 34 && refused == 40, "{inside} {refused}");
}
