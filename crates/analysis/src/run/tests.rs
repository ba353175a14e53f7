//! Runs whose touches have one reference, on a free resonance that walks.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rig_contact::{Contact, Depth, Direction, Pose, SensorDescription, Tissue};

use super::*;
use crate::model::Verdict;

const SAMPLES_MPA: [f64; 2] = [0.045, 0.32];
const HELD: Depth = Depth::Indentation { along_probe_mm: 0.5 };
const TRIALS: u64 = 90;
const OWN_HZ: f64 = 0.05;
const SWEEP_HZ: f64 = 0.05;
/// What the free resonance walks from one touch to the next, Hz.
const STEP_HZ: f64 = 0.08;

/// The touches of a run without errors: of each sample in all directions at these angles, and then the blind ones.
fn smooth(described: &Compensation) -> Vec<PosedTouch> {
    let models = &described.models;
    let mut touches = Vec::new();
    let blind = [(0, Direction::Front, 30.0), (1, Direction::Left, 15.0)];
    let main = (0..2).flat_map(|sample| {
        let angles = [0.0, 20.0, 40.0];
        Direction::ALL.into_iter().flat_map(move |one| angles.map(|angle| (sample, one, angle)))
    });
    for (sample, direction, angle_deg) in main.chain(blind) {
        let pose = Pose::leaning(direction, f64::to_radians(angle_deg)).unwrap();
        let contact = Contact { friction: described.friction, ..Contact::new(pose, HELD) };
        let tissue = Tissue::soft(SAMPLES_MPA[sample]).unwrap();
        let found = models.predict(described.tier, &tissue, &contact).unwrap();
        touches.push(PosedTouch {
            sample,
            pose,
            depth: HELD,
            shift_hz: found.shift_hz,
            sigma_hz: 0.0,
            reference_sigma_hz: 0.0,
            halfway: None,
            stage_sigma_mm: None,
        });
    }
    touches
}

/// Root mean squares of errors and of what is stated of them, and how often a model was strained.
#[derive(Debug, Default)]
struct Sums {
    samples: [f64; 2],
    blind: [f64; 2],
    strained: u32,
}

impl Sums {
    fn ratio([error, stated]: [f64; 2]) -> f64 {
        (error / stated).sqrt()
    }
}

fn trials(known_mpa: &[Option<f64>], is_shared: bool, source: ModelSource) -> Sums {
    let described = Compensation {
        depth_sigma_mm: 1e-5,
        angle_sigma_rad: 1e-5,
        ..Compensation::new(&SensorDescription::reference(), 0.0)
    };
    let smooth = smooth(&described);
    let main = smooth.len() - 2;
    let walked_hz2 = |touch: usize| (touch as f64 + 1.0) * STEP_HZ * STEP_HZ;
    let entry = |i: usize, j: usize| SWEEP_HZ * SWEEP_HZ + walked_hz2(i.min(j));
    let hz2: Vec<Vec<f64>> =
        (0..smooth.len()).map(|i| (0..smooth.len()).map(|j| entry(i, j)).collect()).collect();
    let mut sums = Sums::default();
    for seed in 0..TRIALS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // Box and Muller; the first is never zero.
        let mut normal = || {
            let [a, b] = [0, 1].map(|_| (random.next_u64() as f64 + 1.0) / 2.0_f64.powi(64));
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let mut off_hz = SWEEP_HZ * normal();
        let mut touched = |(index, touch): (usize, &PosedTouch)| {
            off_hz += STEP_HZ * normal();
            let reference_sigma_hz = hz2[index][index].sqrt();
            PosedTouch {
                shift_hz: touch.shift_hz + off_hz + OWN_HZ * normal(),
                sigma_hz: reference_sigma_hz.hypot(OWN_HZ),
                reference_sigma_hz,
                ..*touch
            }
        };
        let touches: Vec<PosedTouch> = smooth.iter().enumerate().map(&mut touched).collect();
        let run = RunTouches {
            main: &touches[..main],
            blind: &touches[main..],
            known_mpa,
            sample_rel: 1e-4,
            depth_correlation: None,
            reference_hz2: is_shared.then_some(hz2.as_slice()),
            resonance_ratio: 1.0,
            scale_rel: 0.0,
        };
        let (found, model) = at_known_angles(&described, &run, source);
        for one in &found.samples {
            sums.samples[0] += (one.young_mpa / SAMPLES_MPA[one.sample]).ln().powi(2);
            sums.samples[1] += (one.sigma_mpa / one.young_mpa).powi(2);
        }
        for (one, touch) in found.blind.iter().zip(&touches[main..]) {
            let young = one.unwrap().whole();
            sums.blind[0] += (young.mpa / SAMPLES_MPA[touch.sample]).ln().powi(2);
            sums.blind[1] += (young.sigma_mpa / young.mpa).powi(2);
        }
        let holds = model.check().is_none_or(|check| check.verdict == Verdict::Holds);
        sums.strained += u32::from(!holds);
    }
    sums
}

/// The mean of the touches of a sample, and a blind touch that is divided by the factor of known samples, err as is stated, and a
/// model that is the truth holds. As independent, the errors of the means would be twice what is stated.
#[test]
fn the_stiffness_of_touches_with_one_reference_is_as_uncertain_as_what_they_share_makes_it() {
    let (none, first) = ([None; 2], [Some(SAMPLES_MPA[0]), None]);
    for (known_mpa, source) in [
        (&none, ModelSource::Described),
        (&first, ModelSource::Described),
        (&none, ModelSource::Learnt),
    ] {
        let shared = trials(known_mpa, true, source);
        let told = format!("{known_mpa:?} {source:?}: {shared:?}");
        assert!((0.8..1.2).contains(&Sums::ratio(shared.samples)), "{told}");
        assert!((0.8..1.2).contains(&Sums::ratio(shared.blind)), "{told}");
        assert!(shared.strained < 7, "{told}");
    }
    let alone = trials(&none, false, ModelSource::Described);
    assert!(Sums::ratio(alone.samples) > 1.8, "{alone:?}");
}

/// The touches that are compared are at one place of the stages and share half of the variance of their depth. That makes the
/// samples scatter less, so that a scatter that seems to be chance is none.
#[test]
fn what_known_samples_share_by_their_depth_does_not_explain_their_scatter() {
    let described = Compensation {
        depth_sigma_mm: 0.02,
        angle_sigma_rad: 1e-5,
        ..Compensation::new(&SensorDescription::reference(), 0.0)
    };
    let touched = |touch: PosedTouch| PosedTouch { sigma_hz: 0.01, ..touch };
    let touches: Vec<PosedTouch> = smooth(&described).into_iter().map(touched).collect();
    let main = touches.len() - 2;
    let sigma_rel = |off: f64| {
        let known_mpa = [Some(SAMPLES_MPA[0] * (1.0 + off)), Some(SAMPLES_MPA[1] / (1.0 + off))];
        let run = RunTouches {
            main: &touches[..main],
            blind: &touches[main..],
            known_mpa: &known_mpa,
            sample_rel: 1e-4,
            depth_correlation: None,
            reference_hz2: None,
            resonance_ratio: 1.0,
            scale_rel: 0.0,
        };
        at_known_angles(&described, &run, ModelSource::Described).0.calibration.sigma_rel
    };
    let (alike, apart) = (sigma_rel(0.0), sigma_rel(0.01));
    assert!(apart > 1.1 * alike, "{alike} {apart}");
}
