//! Whether each part of the variance is as large as its cause alone makes it.

use super::*;

/// Every cause has its own standard deviation.
const SIGMAS: ShiftSigmas = ShiftSigmas { resonance_hz: 0.2, reference_hz: 0.15, sample_hz: 0.3 };
const PARTS_MODEL: TouchModel =
    TouchModel { shared_depth_sigma_mm: 0.015, depth_sigma_mm: 0.01, ..TOUCH_MODEL };

/// The errors of a site in standard deviations: three of the shift and one of the depth for each touch,
/// and one of the depth for all.
#[derive(Clone)]
struct Errors {
    of_touches: Vec<[f64; 4]>,
    of_site: f64,
}

impl Errors {
    fn drawn(touches: usize, random: &mut Stream) -> Self {
        let of_touches = (0..touches).map(|_| [(); 4].map(|()| random.normal())).collect();
        Self { of_touches, of_site: random.normal() }
    }

    /// Only the errors of one cause, in the order of the fields of [`LogVariances`].
    fn of(&self, cause: usize) -> Self {
        let only = |errors: &[f64; 4]| {
            std::array::from_fn(|index| if index == cause { errors[index] } else { 0.0 })
        };
        Self {
            of_touches: self.of_touches.iter().map(only).collect(),
            of_site: if cause == 4 { self.of_site } else { 0.0 },
        }
    }
}

/// The truth of a site.
#[derive(Clone, Copy)]
struct Truth<'a> {
    models: &'a Models,
    young_mpa: f64,
    degrees: f64,
    azimuth_rad: f64,
    spins: &'a [f64],
}

impl Truth<'_> {
    fn touches(&self, errors: &Errors) -> Vec<SiteTouch> {
        let Self { models, young_mpa, degrees, azimuth_rad, spins } = *self;
        let shared_mm = PARTS_MODEL.shared_depth_sigma_mm * errors.of_site;
        let depth_mm = |own: f64| 0.4 + shared_mm + PARTS_MODEL.depth_sigma_mm * own;
        let ways: Vec<(f64, f64)> = spins
            .iter()
            .zip(&errors.of_touches)
            .map(|(&spin, [.., own])| (spin, depth_mm(*own)))
            .collect();
        let mut touches = touches(models, young_mpa, degrees, azimuth_rad, &ways);
        for (touch, [resonance, reference, sample, _]) in touches.iter_mut().zip(&errors.of_touches)
        {
            touch.depth = Depth::Indentation { along_probe_mm: 0.4 };
            touch.sigmas = SIGMAS;
            touch.shift_hz += SIGMAS.resonance_hz * resonance
                + SIGMAS.reference_hz * reference
                + SIGMAS.sample_hz * sample;
        }
        touches
    }

    fn infer(&self, errors: &Errors) -> TiltInference {
        let touches = self.touches(errors);
        infer_tilt(self.models, &touches, &PARTS_MODEL, TO_45, AzimuthPrior::Unknown).unwrap()
    }

    /// The logarithm of the stiffness for one who knows the tilt.
    fn log_at_its_tilt(&self, errors: &Errors) -> f64 {
        let angle = AnglePrior::Known { angle_rad: self.degrees.to_radians(), sigma_rad: 1e-6 };
        let azimuth = AzimuthPrior::Known(self.azimuth_rad);
        let touches = self.touches(errors);
        let found = infer_tilt(self.models, &touches, &PARTS_MODEL, angle, azimuth).unwrap();
        found.young_mpa.value.ln()
    }
}

/// Angles and azimuths drawn from the prior. The mean square of what one cause alone changes is the mean of
/// its part; that of what the knowledge of the tilt changes is the mean of the last part.
#[track_caller]
fn check(spins: &[f64], seed: u64) {
    const TRIALS: u32 = 500;
    let models = models();
    let mut random = Stream::new(seed, 2);
    let (mut stated, mut made) = ([0.0; 7], [0.0; 7]);
    for _ in 0..TRIALS {
        let truth = Truth {
            models: &models,
            young_mpa: 0.1 * 6.0_f64.powf(random.uniform()),
            degrees: 45.0 * random.uniform(),
            azimuth_rad: TAU * random.uniform(),
            spins,
        };
        let errors = Errors::drawn(spins.len(), &mut random);
        let TiltInference { young_mpa, log_variances, .. } = truth.infer(&errors);
        let sigma_rel = young_mpa.sigma / young_mpa.value;
        assert!((log_variances.sum().sqrt() / sigma_rel - 1.0).abs() < 1e-9, "{log_variances:?}");
        let LogVariances { resonance, reference, sample, own_depth, shared_depth, tilt } =
            log_variances;
        let parts = [resonance, reference, sample, own_depth, shared_depth, tilt];
        let log_true = truth.young_mpa.ln();
        for (cause, part) in parts.into_iter().enumerate() {
            let error = if cause < 5 {
                truth.log_at_its_tilt(&errors.of(cause)) - log_true
            } else {
                young_mpa.value.ln() - truth.log_at_its_tilt(&errors)
            };
            stated[cause] += part;
            made[cause] += error * error;
        }
        stated[6] += log_variances.sum();
        made[6] += (young_mpa.value.ln() - log_true).powi(2);
    }
    let causes = ["resonance", "reference", "sample", "own depth", "shared depth", "tilt", "all"];
    for (cause, (made, stated)) in causes.into_iter().zip(made.iter().zip(stated)) {
        let ratio = (made / stated).sqrt();
        println!("seed {seed}, {} touches, {cause}: {ratio:.3}", spins.len());
        // The standard deviation of the root of a mean of 500 squares is 3 % for equal variances; these
        // differ.
        assert!(
            (ratio - 1.0).abs() < 0.15,
            "seed {seed}, {} touches, {cause}: {ratio}",
            spins.len()
        );
    }
}

#[test]
fn each_part_of_a_blind_touch_is_what_its_cause_makes() {
    check(&[0.0], 11);
}

#[test]
fn each_part_of_a_site_is_what_its_cause_makes() {
    check(&[0.0, 1.0, 2.0], 12);
}
