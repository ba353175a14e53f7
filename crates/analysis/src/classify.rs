//! Classification against calibrated class centres.
//!
//! Values are logarithms of a shift or of a stiffness. Contact angle, depth and scatter multiply a
//! shift, so that soft and stiff classes are about equally wide on a logarithmic scale. In Hz they are
//! not, and k-means splits the stiffest class and merges the softest two.

/// A calibrated class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Class {
    /// Mean of the logarithms.
    pub centre: f64,
    /// Standard deviation of the logarithms.
    pub spread: f64,
}

/// A classifier with calibrated classes.
#[derive(Debug, Clone, PartialEq)]
pub struct Classifier {
    classes: Vec<Class>,
}

/// The class of a value, or its rejection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    /// The most likely class.
    Class {
        /// Index of the class.
        class: usize,
        /// Probability of the class, for equal prior probabilities.
        probability: f64,
    },
    /// The value is too far from every class.
    Unknown {
        /// Index of the nearest class.
        nearest: usize,
        /// Distance to that class in standard deviations.
        distance: f64,
    },
}

/// A refused calibration.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A value is not positive, or its label is out of range.
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
        /// Index of the class.
        class: usize,
        /// Number of its values.
        values: usize,
    },
    /// Two classes have the same centre.
    #[error("calibration: classes {first} and {second} have the same centre")]
    Coincident {
        /// Index of one class.
        first: usize,
        /// Index of the other class.
        second: usize,
    },
}

/// Distance to the nearest class, in standard deviations, beyond which a value is rejected. Over the
/// paper's angles a class is far from normal; five standard deviations hold all of it.
const UNKNOWN_BEYOND: f64 = 5.0;
/// Centres closer than this, in logarithms, are the same number.
const COINCIDENT: f64 = 1e-12;

impl Classifier {
    /// Calibrates classes from positive values of known class.
    ///
    /// All classes share one spread, because a few values estimate a centre better than a spread.
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

    /// Classifies a value with the relative standard deviation `sigma_rel`; `None` for a value that
    /// is not positive, and without classes.
    pub fn classify(&self, value: f64, sigma_rel: f64) -> Option<Decision> {
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
            return Some(Decision::Unknown { nearest, distance });
        }
        let sum: f64 = log_likelihoods.iter().map(|log| (log - best).exp()).sum();
        Some(Decision::Class { class, probability: sum.recip() })
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
        let Decision::Class { class, probability } = at(0.45) else { panic!() };
        assert_eq!(class, 0);
        // The squared distances are 20.25 and 30.25.
        assert!((probability - 1.0 / (1.0 + (-5.0_f64).exp())).abs() < 1e-12, "{probability}");
        let Decision::Class { class, probability } = at(0.5 + 1e-9) else { panic!() };
        assert_eq!(class, 1);
        assert!((probability - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_value_far_from_every_class_is_none_of_them() {
        let two = classes(&[0.0, 3.0]).unwrap();
        let at = |log: f64| two.classify(log.exp(), 0.0).unwrap();
        assert!(matches!(at(0.499), Decision::Class { class: 0, .. }));
        assert!(matches!(at(0.501), Decision::Unknown { nearest: 0, .. }));
        // A value that is itself uncertain may still be one.
        let uncertain = two.classify(0.501_f64.exp(), 0.1);
        assert!(matches!(uncertain, Some(Decision::Class { class: 0, .. })));
        assert_eq!(two.classify(0.0, 0.1), None);
        assert_eq!(two.classify(f64::NAN, 0.1), None);
        assert_eq!(classes(&[]).unwrap().classify(1.0, 0.1), None);
    }

    #[test]
    fn centres_come_from_the_logarithms_and_the_spread_from_all_classes() {
        let classifier = Classifier::calibrated(&[1.0, 4.0, 10.0, 40.0], &[0, 0, 1, 1], 2).unwrap();
        let [soft, hard] = &classifier.classes[..] else { panic!() };
        assert!((soft.centre - 2.0_f64.ln()).abs() < 1e-15);
        assert!((hard.centre - 20.0_f64.ln()).abs() < 1e-15);
        // Each value lies ln 2 from its centre; two of four are free.
        let expected = 2.0_f64.sqrt() * 2.0_f64.ln();
        assert!((soft.spread - expected).abs() < 1e-15 && soft.spread == hard.spread);
    }

    #[test]
    fn calibrations_that_define_no_classes_are_refused() {
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
