//! Readings in the units and the memory layout of the fit.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use std::f64::consts::TAU;

use rig_model::Reading;

use crate::numeric::simd::{Isa, LANES, Lanes};

/// Four readings in units of a reference frequency and a reference capacitance, so that every quantity
/// is near 1.
///
/// With w = f/f₀ and the impedance ζ in units of 1/(2πf₀C₀), p = jwζ is the factor that converts a
/// capacitance to the ratio of its admittance to the measured one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block<F = Lanes> {
    pub(crate) w: F,
    /// w² − 1, computed without loss of digits near 0.
    pub(crate) v: F,
    pub(crate) p_re: F,
    pub(crate) p_im: F,
    /// Cycles integrated, in units of ten; 0 in lanes without a reading.
    pub(crate) weight: F,
}

/// A reading that is not a finite impedance at a positive frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NotFinite {
    /// Index of the reading, from 0.
    pub(crate) index: usize,
}

/// The readings of a fit. Each lane holds consecutive readings.
#[derive(Debug, Clone, Default)]
pub(crate) struct Points {
    pub(crate) blocks: Vec<Block>,
    /// Number of readings.
    pub(crate) count: usize,
    /// Number of overloaded readings, which are excluded.
    pub(crate) overloaded: usize,
    pub(crate) reference_hz: f64,
    pub(crate) reference_farad: f64,
    pub(crate) lowest_hz: f64,
    pub(crate) highest_hz: f64,
    /// Whether the frequency only rises or only falls.
    pub(crate) is_monotonic: bool,
    /// The shortest settling time, s.
    pub(crate) settle_s: f64,
    /// The sum of the weights.
    pub(crate) total_weight: f64,
}

impl Points {
    /// Loads readings and reuses the memory of earlier ones.
    ///
    /// # Errors
    /// A reading without overload whose frequency is not a positive number or whose impedance is
    /// zero or not finite.
    pub(crate) fn load(&mut self, readings: &[Reading]) -> Result<(), NotFinite> {
        self.scan(readings)?;
        let inverse_hz = 1.0 / self.reference_hz;
        let unit_siemens = TAU * self.reference_hz * self.reference_farad;
        self.blocks.clear();
        self.blocks.resize(self.count.div_ceil(LANES), Block::EMPTY);
        self.total_weight = 0.0;
        let (mut place, mut lane) = (0, 0);
        for reading in readings {
            let Some(impedance) = reading.impedance() else { continue };
            if place == self.blocks.len() {
                (place, lane) = (0, lane + 1);
            }
            let block = &mut self.blocks[place];
            let w = reading.frequency_hz * inverse_hz;
            let scale = unit_siemens * w;
            let weight = weight(reading);
            block.w.0[lane] = w;
            block.v.0[lane] = (w - 1.0) * (w + 1.0);
            block.p_re.0[lane] = -scale * impedance.reactance_ohm;
            block.p_im.0[lane] = scale * impedance.resistance_ohm;
            block.weight.0[lane] = weight;
            self.total_weight += weight;
            place += 1;
        }
        Ok(())
    }

    /// Number of readings with a neighbour in the next block.
    pub(crate) fn pairs(&self) -> usize {
        let lanes = self.count.div_ceil(self.blocks.len().max(1));
        self.count - lanes
    }

    /// Finds the units and checks the readings.
    fn scan(&mut self, readings: &[Reading]) -> Result<(), NotFinite> {
        let (mut lowest, mut highest) = (f64::INFINITY, 0.0_f64);
        let (mut count, mut sum, mut settle_s) = (0_usize, 0.0, f64::INFINITY);
        let (mut before, mut rises, mut falls) = (f64::NAN, false, false);
        for (index, reading) in readings.iter().enumerate() {
            let Some(impedance) = reading.impedance() else { continue };
            let squared = impedance.resistance_ohm.powi(2) + impedance.reactance_ohm.powi(2);
            let size = squared * reading.frequency_hz * reading.frequency_hz;
            if !(reading.frequency_hz > 0.0 && size > 0.0 && size.is_finite()) {
                return Err(NotFinite { index });
            }
            settle_s = settle_s.min(reading.settle_s);
            rises |= reading.frequency_hz > before;
            falls |= reading.frequency_hz < before;
            before = reading.frequency_hz;
            lowest = lowest.min(reading.frequency_hz);
            highest = highest.max(reading.frequency_hz);
            // The mean of 1/|Zf|² is dominated by large admittances and hardly affected by an open
            // contact.
            sum += 1.0 / size;
            count += 1;
        }
        self.count = count;
        self.overloaded = readings.len() - count;
        (self.lowest_hz, self.highest_hz) = (lowest, highest);
        self.settle_s = settle_s;
        self.is_monotonic = !(rises && falls);
        self.reference_hz = 0.5 * (lowest + highest);
        self.reference_farad = (sum / count as f64).sqrt() / TAU;
        Ok(())
    }
}

impl Block {
    /// Converts to the vectors of an instruction set.
    #[inline(always)]
    pub(crate) fn on<M: Isa>(&self, machine: M) -> Block<M::F64x4> {
        let Self { w, v, p_re, p_im, weight } = self;
        Block {
            w: machine.of(w),
            v: machine.of(v),
            p_re: machine.of(p_re),
            p_im: machine.of(p_im),
            weight: machine.of(weight),
        }
    }

    /// Lanes without a reading: finite numbers of weight 0.
    const EMPTY: Self = Self {
        w: Lanes::splat(1.0),
        v: Lanes::ZERO,
        p_re: Lanes::splat(1.0),
        p_im: Lanes::ZERO,
        weight: Lanes::ZERO,
    };
}
/// Cycles integrated, in units of ten; 1 if the time is unknown.
#[inline]
pub(crate) fn weight(reading: &Reading) -> f64 {
    tens_of_cycles(reading.integration_s * reading.frequency_hz)
}

#[inline]
fn tens_of_cycles(cycles: f64) -> f64 {
    if cycles > 0.0 { 0.1 * cycles } else { 1.0 }
}
