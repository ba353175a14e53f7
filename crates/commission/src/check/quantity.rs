//! The quantities of the daily check.

/// A quantity that stays the same while the bench does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The resonance with the probe clear.
    FreeResonance,
    /// The surface of the level block.
    Surface,
    /// Mean of the surface at 45° to the front and to the back, less that of the level block.
    TiltSum,
    /// The surface at 45° to the front less that to the back.
    TiltDifference,
    /// The logarithm of the frequency shift, Hz, on the first reference sample.
    FirstReference,
    /// The logarithm of the shift on the second reference sample.
    SecondReference,
    /// The logarithm of the shift on the second reference sample over that on the first.
    ReferenceRatio,
}

impl Quantity {
    /// All of them, in the order of records and charts.
    pub const ALL: [Self; 7] = [
        Self::FreeResonance,
        Self::Surface,
        Self::TiltSum,
        Self::TiltDifference,
        Self::FirstReference,
        Self::SecondReference,
        Self::ReferenceRatio,
    ];

    /// Its name in records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FreeResonance => "check.free_resonance",
            Self::Surface => "check.surface",
            Self::TiltSum => "check.tilt_sum",
            Self::TiltDifference => "check.tilt_difference",
            Self::FirstReference => "check.first_reference",
            Self::SecondReference => "check.second_reference",
            Self::ReferenceRatio => "check.reference_ratio",
        }
    }

    /// Its unit; 1 for a logarithm.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::FreeResonance => "Hz",
            Self::Surface | Self::TiltSum | Self::TiltDifference => "mm",
            Self::FirstReference | Self::SecondReference | Self::ReferenceRatio => "1",
        }
    }

    /// What it is, for a person. It fits beside five numbers into a line of 80 characters; log is the natural logarithm.
    pub const fn text(self) -> &'static str {
        match self {
            Self::FreeResonance => "free resonance",
            Self::Surface => "surface of the level block",
            Self::TiltSum => "surface at ±45°, mean less level",
            Self::TiltDifference => "surface at ±45°, front less back",
            Self::FirstReference => "first reference, log of its shift",
            Self::SecondReference => "second reference, log of its shift",
            Self::ReferenceRatio => "second reference over first, log",
        }
    }

    /// The least standard deviation from check to check that counts, in its unit: a smaller one is that of no bench, and
    /// a change by some of it changes no touch by 1 %.
    pub const fn least_sigma(self) -> f64 {
        match self {
            Self::FreeResonance => 0.01,
            Self::Surface | Self::TiltSum | Self::TiltDifference => 0.001,
            Self::FirstReference | Self::SecondReference | Self::ReferenceRatio => 0.002,
        }
    }

    /// What a person looks at when it has changed.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::FreeResonance => {
                "see that nothing sticks to the probe, that sensor and cable are fixed, and that the bench is warm"
            }
            Self::Surface => {
                "clean the block and the ball; then look for a loose clamp of the sensor, a worn ball, or a lost zero of \
                 the linear stage"
            }
            Self::TiltSum => {
                "see that block and holder lie flat; then look at the height of the surface above the rotary axis and at \
                 the scale of the rotary stage"
            }
            Self::TiltDifference => {
                "look for a lost zero of the rotary stage, and for a probe that was bent to a side"
            }
            Self::FirstReference | Self::SecondReference => {
                "clean ball and sample; if both references have changed alike, look for a worn ball and a wrong depth; if one \
                 has, look at that sample"
            }
            Self::ReferenceRatio => {
                "see that each reference sample is in its place, and measure both beside another sample of known stiffness"
            }
        }
    }

    pub(super) const fn index(self) -> usize {
        self as usize
    }
}
