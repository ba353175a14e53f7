//! Classification against calibrated centres: what is known of the samples before the blind touches.
//!
//! Values are logarithms, of a shift or of a stiffness: contact angle, depth and scatter multiply a
//! shift, so that on a logarithmic scale every class is about equally wide, soft or stiff. k-means
//! on shifts in Hz splits the stiffest class and merges the softest two because it is not.

/// A class as its calibration found it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Class {
    /// Mean of the logarithms.
    pub centre: f64,
    /// Their standard deviation.
    pub spread: f64,
}

/// Classes to compare with.
#[derive(Debug, Clone, PartialEq)]
pub struct Classifier {
    classes: Vec<Class>,
}

/// What a value is taken for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// A class, the likeliest of all.
    Class {
        /// Its index.
        class: usize,
        /// Its probability, when all classes were equally likely beforehand.
        probability: f64,
    },
    /// Too far from every class to be one of them.
    Unknown {
        /// The nearest class.
        nearest: usize,
        /// How far it is, in standard deviations.
        distance: f64,
    },
}

/// Why there is no classifier.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A value is no positive number, or does not name a class.
    #[error("calibration: value {index} is not a positive number of a class below {classes}")]
    NotUsable {
        /// Index of the value.
        index: usize,
        /// Number of classes.
        classes: usize,
    },
    /// A class has too few values to have a centre and a spread.
    #[error("calibration: class {class} has {values} values, at least 2 are needed")]
    TooFewValues {
        /// The class.
        class: usize,
        /// How many values it has.
        values: usize,
    },
    /// Two classes have the same centre: no value could tell them apart.
    #[error("calibration: classes {first} and {second} have the same centre")]
    Coincident {
        /// One of them.
        first: usize,
        /// The other.
        second: usize,
    },
}

/// Standard deviations from the nearest class beyond which a value is none of them. Within the
/// paper's angles a class is far from normal; five standard deviations hold all of it.
const UNKNOWN_BEYOND: f64 = 5.0;
/// Centres closer than this, in logarithms, are the same number.
const COINCIDENT: f64 = 1e-12;

impl Classifier {
    /// Calibrates classes from positive values of known class.
    ///
    /// The spread is shared by all classes, because a handful of values gives a better centre than
    /// spread.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn calibrated(
        values: &[f64],
        labels: &[usize],
        classes: usize,
    ) -> Result<Self, CalibrationError> {
        let mut logs = vec![Vec::new(); classes];
        for (index, (&value, &label)) in values.iter().zip(labels).enumerate() {
            if !(value.is_finite() && value > 0.0 && label < classes) {
                return Err(CalibrationError::NotUsable { index, classes });
            }
            logs[label].push(value.ln());
        }
        let (mut squares, mut freedom) = (0.0, 0.0);
        let mut centres = Vec::with_capacity(classes);
        for (class, logs) in logs.iter().enumerate() {
            if logs.len() < 2 {
                return Err(CalibrationError::TooFewValues { class, values: logs.len() });
            }
            let count = logs.len() as f64;
            let centre = logs.iter().sum::<f64>() / count;
            squares += logs.iter().map(|log| (log - centre).powi(2)).sum::<f64>();
            freedom += count - 1.0;
            centres.push(centre);
        }
        let spread = (squares / freedom).sqrt();
        Self::with_classes(centres.into_iter().map(|centre| Class { centre, spread }).collect())
    }

    /// A classifier of these classes.
    ///
    /// # Errors
    /// [`CalibrationError::Coincident`].
    pub fn with_classes(classes: Vec<Class>) -> Result<Self, CalibrationError> {
        for (second, b) in classes.iter().enumerate() {
            for (first, a) in classes.iter().enumerate().take(second) {
                if (a.centre - b.centre).abs() <= COINCIDENT {
                    return Err(CalibrationError::Coincident { first, second });
                }
            }
        }
        Ok(Self { classes })
    }

    /// The classes, in the order of their labels.
    pub fn classes(&self) -> &[Class] {
        &self.classes
    }

    /// Classifies a value whose own relative standard deviation is `sigma_rel`; none for a value
    /// that is not positive, and without classes.
    pub fn classify(&self, value: f64, sigma_rel: f64) -> Option<Verdict> {
        if !(value.is_finite() && value > 0.0) {
            return None;
        }
        let distances = self.classes.iter().map(|class| {
            let spread = class.spread.hypot(sigma_rel).max(f64::MIN_POSITIVE);
            ((value.ln() - class.centre) / spread, spread)
        });
        let log_likelihoods: Vec<f64> = distances
            .clone()
            .map(|(distance, spread)| -0.5 * distance * distance - spread.ln())
            .collect();
        let (class, best) =
            log_likelihoods.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (nearest, distance) = distances
            .map(|(distance, _)| distance.abs())
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        if distance > UNKNOWN_BEYOND {
            return Some(Verdict::Unknown { nearest, distance });
        }
        let sum: f64 = log_likelihoods.iter().map(|log| (log - best).exp()).sum();
        Some(Verdict::Class { class, probability: sum.recip() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn classes(centres: &[f64]) -> Result<Classifier, CalibrationError> {
        let class = |&centre: &f64| Class { centre, spread: 0.1 };
        Classifier::with_classes(centres.iter().map(class).collect())
    }

    #[test]
    fn a_value_belongs_to_the_nearest_class_with_the_odds_of_its_distance() {
        let two = classes(&[0.0, 1.0]).unwrap();
        let at = |log: f64| two.classify(log.exp(), 0.0).unwrap();
        let Verdict::Class { class, probability } = at(0.45) else { panic!() };
        assert_eq!(class, 0);
        // The squared distances are 20.25 and 30.25.
        assert!((probability - 1.0 / (1.0 + (-5.0_f64).exp())).abs() < 1e-12, "{probability}");
        let Verdict::Class { class, probability } = at(0.5 + 1e-9) else { panic!() };
        assert_eq!(class, 1);
        assert!((probability - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_value_far_from_every_class_is_none_of_them() {
        let two = classes(&[0.0, 3.0]).unwrap();
        let at = |log: f64| two.classify(log.exp(), 0.0).unwrap();
        assert!(matches!(at(0.499), Verdict::Class { class: 0, .. }));
        assert!(matches!(at(0.501), Verdict::Unknown { nearest: 0, .. }));
        // A value that is itself uncertain may still be one.
        let uncertain = two.classify(0.501_f64.exp(), 0.1);
        assert!(matches!(uncertain, Some(Verdict::Class { class: 0, .. })));
        assert_eq!(two.classify(0.0, 0.1), None);
        assert_eq!(two.classify(f64::NAN, 0.1), None);
        assert_eq!(classes(&[]).unwrap().classify(1.0, 0.1), None);
    }

    #[test]
    fn centres_come_from_the_logarithms_and_the_spread_from_all_classes() {
        let classifier = Classifier::calibrated(&[1.0, 4.0, 10.0, 40.0], &[0, 0, 1, 1], 2).unwrap();
        let [soft, hard] = classifier.classes() else { panic!() };
        assert!((soft.centre - 2.0_f64.ln()).abs() < 1e-15);
        assert!((hard.centre - 20.0_f64.ln()).abs() < 1e-15);
        // Each value lies ln 2 from its centre; two of four are free.
        let expected = 2.0_f64.sqrt() * 2.0_f64.ln();
        assert!((soft.spread - expected).abs() < 1e-15 && soft.spread == hard.spread);
    }

    #[test]
    fn calibrations_without_sense_are_refused() {
        use CalibrationError::{Coincident, NotUsable, TooFewValues};
        let calibrate = |values: &[f64], labels: &[usize]| {
            Classifier::calibrated(values, labels, 2).unwrap_err()
        };
        assert_eq!(calibrate(&[1.0, -1.0], &[0, 0]), NotUsable { index: 1, classes: 2 });
        assert_eq!(calibrate(&[1.0, 2.0], &[0, 2]), NotUsable { index: 1, classes: 2 });
        assert_eq!(calibrate(&[1.0, 2.0, 3.0], &[0, 0, 1]), TooFewValues { class: 1, values: 1 });
        assert_eq!(
            calibrate(&[1.0, 2.0, 1.0, 2.0], &[0, 0, 1, 1]),
            Coincident { first: 0, second: 1 }
        );
        assert!(classes(&[0.3, 0.3 + 2e-12]).is_ok());
        assert!(classes(&[0.3, 0.3]).is_err());
    }
}
