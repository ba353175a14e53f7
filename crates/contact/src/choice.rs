//! The choice of a tier: the cheapest one whose largest difference from the reference is within a
//! tolerance.
//!
//! The differences are measured over the contacts that are asked for, with their law, friction and
//! tissue, in about two milliseconds. They say how well the tiers agree, and nothing about the accuracy
//! of the reference.

use std::{cell::Cell, fmt};

use crate::{
    Contact, ContactLaw, Depth, Direction, Friction, Models, Pose, Refusal, Sensor, Tier, Tissue,
};

/// The contacts that a model must predict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Requirements {
    /// Sensor in all of these contacts.
    pub sensor: Sensor,
    /// The stiffest tissue; its loss and Poisson's ratio are those of all others.
    pub stiffest: Tissue,
    /// The deepest contact along the probe.
    pub deepest: Depth,
    /// The law of contact radius and force.
    pub law: ContactLaw,
    /// Behaviour along the surface.
    pub friction: Friction,
    /// The largest contact angle, rad.
    pub tilt_max_rad: f64,
    /// Whether the model must give an impedance and not only a shift.
    pub needs_impedance: bool,
}

/// The chosen tier and its agreement with the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Cheapest sufficient tier.
    pub tier: Tier,
    /// The largest difference of its shift from that of the reference in such contacts, Hz.
    pub difference_hz: f64,
    /// The allowed difference, Hz.
    pub tolerance_hz: f64,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tier, difference_hz, tolerance_hz } = self;
        write!(
            f,
            "tier {}: agrees with the reference within {difference_hz:.3} Hz, ",
            tier.name()
        )?;
        write!(f, "{tolerance_hz} Hz allowed")
    }
}

impl Tier {
    /// The cheapest tier whose largest difference from the reference is at most `tolerance_hz` in
    /// contacts in the three directions. It is the reference when no other tier suffices.
    ///
    /// # Errors
    /// [`Refusal`] when the reference takes not all of these contacts.
    pub fn cheapest_for(required: &Requirements, tolerance_hz: f64) -> Result<Choice, Refusal> {
        let measured = Measured::new(required)?;
        for tier in Self::ALL {
            if required.needs_impedance && !tier.validity().has_impedance {
                continue;
            }
            let difference_hz = measured.difference_hz(tier, tolerance_hz)?;
            if difference_hz <= tolerance_hz {
                return Ok(Choice { tier, difference_hz, tolerance_hz });
            }
        }
        Ok(Choice { tier: Self::Reference, difference_hz: 0.0, tolerance_hz })
    }
}

impl Requirements {
    /// The largest difference of a tier's shift from that of the reference in these contacts, Hz;
    /// infinite when the tier takes not all of them.
    ///
    /// # Errors
    /// [`Refusal`] when the reference takes not all of these contacts.
    pub fn difference_hz(&self, tier: Tier) -> Result<f64, Refusal> {
        Measured::new(self)?.difference_hz(tier, f64::INFINITY)
    }
}

/// Stiffnesses at which the tiers are compared, over the largest.
const STIFFNESSES: [f64; 7] = [1.0, 0.8, 0.6, 0.4, 0.25, 0.1, 0.02];
/// Depths at which the tiers are compared, over the largest.
const DEPTHS: [f64; 3] = [1.0, 0.6, 0.25];
/// Angles at which the tiers are compared, over the largest.
const TILTS: [f64; 6] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0];
/// Between these contacts the difference exceeds the largest one found by less than this part.
const MARGIN: f64 = 1.02;
/// Angles below this count as upright, rad.
const UPRIGHT_RAD: f64 = 1e-9;

/// The contacts at which the tiers are compared, and the shifts by the reference as they are asked
/// for.
struct Measured {
    models: Models,
    needs_impedance: bool,
    contacts: Vec<(Tissue, Contact, Cell<Option<f64>>)>,
}

impl Measured {
    fn new(required: &Requirements) -> Result<Self, Refusal> {
        let Requirements { stiffest, deepest, law, friction, .. } = *required;
        let tilt_max_rad = required.tilt_max_rad.max(0.0);
        let tilts: &[f64] = if tilt_max_rad > UPRIGHT_RAD { &TILTS } else { &[0.0] };
        let mut contacts = Vec::new();
        for tilt in tilts {
            let directions = if *tilt == 0.0 { &Direction::ALL[..1] } else { &Direction::ALL[..] };
            for (direction, depth) in
                directions.iter().flat_map(|direction| DEPTHS.map(|depth| (*direction, depth)))
            {
                let pose = Pose::leaning(direction, tilt * tilt_max_rad)?;
                let contact = Contact { pose, depth: deepest.times(depth), law, friction };
                let of = |share: f64| (stiffest.times(share), contact, Cell::new(None));
                contacts.extend(STIFFNESSES.map(of));
            }
        }
        let models = Models::new(&required.sensor, law);
        for (tissue, contact, _) in &contacts {
            models.load(Tier::Reference, tissue, contact)?;
        }
        Ok(Self { models, needs_impedance: required.needs_impedance, contacts })
    }

    /// The largest difference of a tier, Hz, with the margin; only a bound once it exceeds `enough_hz`.
    fn difference_hz(&self, tier: Tier, enough_hz: f64) -> Result<f64, Refusal> {
        let mut largest = 0.0;
        if tier == Tier::Reference {
            return Ok(largest);
        }
        for (tissue, contact, reference) in &self.contacts {
            let Ok(found) = self.shift_hz(tier, tissue, contact) else { return Ok(f64::INFINITY) };
            if reference.get().is_none() {
                reference.set(Some(self.shift_hz(Tier::Reference, tissue, contact)?));
            }
            let expected = reference.get().unwrap_or(f64::NAN);
            largest = f64::max(largest, MARGIN * (found - expected).abs());
            if largest > enough_hz {
                break;
            }
        }
        Ok(largest)
    }

    /// The shift by which a user of the tier sees the contact: that of its circuit, if it needs one.
    fn shift_hz(&self, tier: Tier, tissue: &Tissue, contact: &Contact) -> Result<f64, Refusal> {
        if !self.needs_impedance {
            return Ok(self.models.predict(tier, tissue, contact)?.shift_hz);
        }
        let circuit = self.models.circuit(tier, tissue, contact)?;
        Ok(circuit.series_resonance_hz - self.models.free_circuit_by(tier).series_resonance_hz)
    }
}

#[cfg(test)]
mod tests;
