//! Student's distribution as normal scores.

/// The normal score with the same probability beyond it as Student's `t` with this many degrees of freedom, to four digits
/// from 5 degrees on.
///
/// # Source
/// G. W. Hill, Algorithm 395: Student's t-distribution, Communications of the ACM 13 (1970) 617.
pub(super) fn normal_score(t: f64, degrees: f64) -> f64 {
    let (a, log) = (degrees - 0.5, (t * t / degrees).ln_1p());
    let (b, y) = (48.0 * a * a, a * log);
    let inner = (((-0.4 * y - 3.3) * y - 24.0) * y - 85.5) / (0.8 * y * y + 100.0 + b);
    ((inner + y + 3.0) / b + 1.0) * y.sqrt() * t.signum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From tables of both distributions: the same probability on both sides, 0.05, 0.01, 0.001.
    #[test]
    fn quantiles_of_student_become_those_of_the_normal_distribution() {
        for (degrees, t, normal) in [
            (5.0, 2.570_58, 1.959_96),
            (5.0, 4.032_14, 2.575_83),
            (9.0, 2.262_16, 1.959_96),
            (9.0, 3.249_84, 2.575_83),
            (9.0, 4.780_91, 3.290_53),
            (30.0, 2.042_27, 1.959_96),
            (30.0, 3.645_96, 3.290_53),
            (120.0, 1.979_93, 1.959_96),
        ] {
            for sign in [1.0, -1.0] {
                let score = normal_score(sign * t, degrees);
                assert!((score - sign * normal).abs() < 2e-4, "{degrees}, {t}: {score}");
            }
        }
        assert_eq!(normal_score(0.0, 9.0), 0.0);
    }
}
