//! The models of one sensor and contact in all tiers, at different cost.

use crate::{
    Circuit, Contact, ContactLaw, Depth, Element, ExactBeam, Load, Lumped, Pose, Reference,
    Refusal, Sensor, Tier, Tissue, rest::Rest,
};

/// The prediction of a tier for a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// The contact at rest.
    pub load: Load,
    /// The shift of the series resonance, Hz.
    pub shift_hz: f64,
}

/// All tiers of one sensor, prepared for one contact law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Models {
    sensor: Sensor,
    tip_n_per_m: f64,
    lumped: Lumped,
    element: Element,
    exact: ExactBeam,
    reference: Reference,
}

impl Models {
    /// Prepares every tier of a sensor for this contact law.
    pub fn new(sensor: &Sensor, law: ContactLaw) -> Self {
        Self {
            sensor: *sensor,
            tip_n_per_m: sensor.section().tip_n_per_m(),
            lumped: Lumped::new(sensor, law),
            element: Element::new(sensor),
            exact: ExactBeam::new(sensor),
            reference: Reference::new(sensor),
        }
    }

    /// The modelled sensor.
    pub const fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Resonance of the free sensor by this tier, Hz.
    pub fn no_load_hz(&self, tier: Tier) -> f64 {
        match tier {
            Tier::T0 | Tier::T0b | Tier::T1 | Tier::T2 | Tier::T2s => self.lumped.no_load_hz(),
            Tier::E1 | Tier::E1s => self.element.no_load_hz(),
            Tier::Exact => self.exact.no_load_hz(),
            Tier::Reference => self.reference.no_load_hz(),
        }
    }

    /// The contact at rest and the shift that it causes.
    ///
    /// # Errors
    /// [`Refusal`] when the contact is outside the law or the tier.
    pub fn predict(
        &self,
        tier: Tier,
        tissue: &Tissue,
        contact: &Contact,
    ) -> Result<Prediction, Refusal> {
        let load = self.load(tier, tissue, contact)?;
        let shift_hz = self.shift_of_load(tier, tissue, &contact.pose, &load);
        Ok(Prediction { load, shift_hz })
    }

    /// The shift of the series resonance by a contact at rest, Hz.
    ///
    /// The load must be within the tier's validity, as [`Models::predict`] checks it.
    pub fn shift_of_load(&self, tier: Tier, tissue: &Tissue, pose: &Pose, load: &Load) -> f64 {
        let normal = load.normal_n_per_m;
        match tier {
            Tier::T0 => self.lumped.proportional_hz(normal),
            Tier::T0b => self.lumped.loaded_hz(normal),
            Tier::T1 => self.lumped.upright_hz(normal),
            Tier::T2 | Tier::T2s => {
                // Without contact there is no ratio, and no shift either.
                let ratio = load.tangential_n_per_m / normal.max(f64::MIN_POSITIVE);
                self.lumped.tilted_hz(pose, normal, ratio)
            }
            Tier::E1 | Tier::E1s => self.element.shift_hz(pose, load),
            Tier::Exact => self.exact.shift_hz(pose, load),
            Tier::Reference => self.reference.shift_hz(pose, load, tissue),
        }
    }

    /// The equivalent circuit of the sensor that touches nothing, by the reference.
    #[expect(clippy::missing_panics_doc, reason = "the tissue is one, and touches nothing")]
    pub fn free_circuit(&self) -> Circuit {
        let tissue = Tissue::soft(1.0).expect("its stiffness is positive");
        self.reference.circuit(&Pose::UPRIGHT, &Load::NONE, &tissue)
    }

    /// The equivalent circuit of the sensor that touches nothing, by one element or by the reference.
    pub(crate) fn free_circuit_by(&self, tier: Tier) -> Circuit {
        match tier {
            Tier::E1 | Tier::E1s => self.element.free_circuit(),
            _ => self.free_circuit(),
        }
    }

    /// The equivalent circuit in contact. Without contact it is exactly that of the free sensor.
    ///
    /// # Errors
    /// [`Refusal::NoImpedance`] when the tier has no electrodes, and as [`Models::predict`].
    pub fn circuit(
        &self,
        tier: Tier,
        tissue: &Tissue,
        contact: &Contact,
    ) -> Result<Circuit, Refusal> {
        check_control(tier, contact)?;
        let load = self.sensor.load(tissue, contact)?;
        self.circuit_of_load(tier, tissue, &contact.pose, &load)
    }

    /// The equivalent circuit of a sensor under this load, which must come from [`Sensor::load_on`] or
    /// [`Sensor::load`].
    ///
    /// # Errors
    /// [`Refusal::NoImpedance`] when the tier has no electrodes, [`Refusal::TooStiff`] and
    /// [`Refusal::Turned`] when the load is outside of it.
    pub fn circuit_of_load(
        &self,
        tier: Tier,
        tissue: &Tissue,
        pose: &Pose,
        load: &Load,
    ) -> Result<Circuit, Refusal> {
        self.check_load(tier, pose, load)?;
        match tier {
            Tier::E1 | Tier::E1s => Ok(self.element.circuit(pose, load, tissue)),
            Tier::Reference => Ok(self.reference.circuit(pose, load, tissue)),
            Tier::T0 | Tier::T0b | Tier::T1 | Tier::T2 | Tier::T2s | Tier::Exact => {
                Err(Refusal::NoImpedance { tier })
            }
        }
    }

    /// The contact at rest, if it is within the tier's validity.
    pub(crate) fn load(
        &self,
        tier: Tier,
        tissue: &Tissue,
        contact: &Contact,
    ) -> Result<Load, Refusal> {
        check_control(tier, contact)?;
        let load = self.sensor.load(tissue, contact)?;
        self.check_load(tier, &contact.pose, &load)?;
        Ok(load)
    }

    fn check_load(&self, tier: Tier, pose: &Pose, load: &Load) -> Result<(), Refusal> {
        let ratio = self.stiffness_ratio(load);
        let limit = tier.validity().stiffness_ratio_max;
        if ratio > limit {
            return Err(Refusal::TooStiff { tier, ratio, limit });
        }
        self.check_turn(tier, pose, load.force_n)
    }

    /// Refuses a force that turns the end of the sensor by more than the tier's limit.
    pub(crate) fn check_turn(&self, tier: Tier, pose: &Pose, force_n: f64) -> Result<(), Refusal> {
        let limit_rad = tier.validity().turn_max_rad;
        let turn_rad = Rest::of(self.sensor.section(), pose, force_n).turn_rad;
        if turn_rad <= limit_rad {
            return Ok(());
        }
        let [turn_deg, limit_deg] = [turn_rad, limit_rad].map(f64::to_degrees);
        Err(Refusal::Turned { tier, turn_deg, limit_deg })
    }

    /// The normal contact stiffness over that of the sensor's tip.
    pub fn stiffness_ratio(&self, load: &Load) -> f64 {
        load.normal_n_per_m / self.tip_n_per_m
    }

    /// The closed-form tiers.
    pub(crate) const fn lumped(&self) -> &Lumped {
        &self.lumped
    }

    /// Stiffness of the sensor's tip, 3EI/L³, N/m.
    pub(crate) const fn tip_n_per_m(&self) -> f64 {
        self.tip_n_per_m
    }
}

/// Refuses a stage move for a tier without static deflection.
pub(crate) fn check_control(tier: Tier, contact: &Contact) -> Result<(), Refusal> {
    if matches!(contact.depth, Depth::Stage { .. }) && !tier.validity().takes_stage_moves {
        return Err(Refusal::StageMove { tier });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
