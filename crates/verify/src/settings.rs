//! What the journal says of the rig and the protocol: the text of both files, read with types of its
//! own. Keys that do not matter here are ignored.

#![expect(clippy::struct_field_names, reason = "the keys of the files, which end in their units")]

use serde::Deserialize;

use crate::{aim, record::RunStarted};

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Rig {
    pub(crate) connection: Option<String>,
    #[serde(default)]
    pub(crate) samples: Vec<KnownSample>,
    pub(crate) linear: Linear,
    pub(crate) rotary: Rotary,
    pub(crate) geometry: Geometry,
    pub(crate) limits: Limits,
}

/// A sample whose stiffness a file states.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct KnownSample {
    pub(crate) name: String,
    pub(crate) stiffness_mpa: Option<f64>,
}

/// A scene file, as far as it matters here.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Scene {
    #[serde(default)]
    pub(crate) samples: Vec<KnownSample>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Linear {
    pub(crate) soft_limits_mm: [f64; 2],
    pub(crate) clear_mm: f64,
    pub(crate) tolerance_mm: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Rotary {
    pub(crate) soft_limits_deg: [f64; 2],
    pub(crate) tolerance_deg: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Geometry {
    surface_mm: f64,
    surface_above_pivot_mm: f64,
    #[serde(default)]
    probe_beside_pivot_mm: f64,
    probe_radius_mm: f64,
    sample_half_width_mm: f64,
    surface_tolerance_mm: f64,
    /// Of a pin in place of a flat sample.
    pin_radius_mm: Option<f64>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Limits {
    pub(crate) max_indentation_mm: f64,
    pub(crate) travel_speed_mm_per_s: f64,
    pub(crate) contact_speed_mm_per_s: f64,
    pub(crate) rotary_speed_deg_per_s: f64,
}

/// Room between the probe and the corner of a sample that turns below it, mm.
const TURN_ROOM_MM: f64 = 0.5;

impl Rig {
    /// Height of the linear stage at which the ball touches the tilted plane of the sample, mm.
    ///
    /// With the normal n = (sin α, cos α) of the plane at the distance d from the pivot, the centre of
    /// a touching ball of radius R has the distance d + R; its tip is R below the centre.
    ///
    /// A pin that is touched at its top when it is level has its axis at the distance a = |(p, d − ρ)| from the pivot, at an
    /// angle φ from the normal, and its centre has the distance ρ + R from that of the ball.
    pub(crate) fn surface_mm(&self, tilt_deg: f64) -> f64 {
        let Geometry { surface_mm, surface_above_pivot_mm: d, probe_radius_mm: r, .. } =
            self.geometry;
        let p = self.geometry.probe_beside_pivot_mm;
        if let Some(pin) = self.geometry.pin_radius_mm {
            let (a, phi) = (p.hypot(d - pin), p.atan2(d - pin));
            let (sin, cos) = (phi + tilt_deg.to_radians()).sin_cos();
            let beside = ((a * sin - p) / (pin + r)).clamp(-1.0, 1.0).asin();
            return surface_mm - d + a * cos + (pin + r) * beside.cos() - r;
        }
        let (sin, cos) = tilt_deg.to_radians().sin_cos();
        surface_mm - d + (d + r - p * sin) / cos - r
    }

    /// The lowest height at which the sample may turn between two tilts below the probe, mm. It is the clear
    /// position, or that of the highest corner of the largest sample on the way and [`TURN_ROOM_MM`].
    ///
    /// A corner has the distance r from the pivot, at the angle φ above the level of the sample, and rises to
    /// r sin(φ + α); it passes above the pivot if a tilt of the turn is 90° − φ.
    pub(crate) fn turn_mm(&self, from_deg: f64, to_deg: f64) -> f64 {
        // A read-back is off by the tolerance at most, and the stage by as much again from a target.
        let off_deg = self.rotary.tolerance_deg;
        self.edge_mm((from_deg.abs() + off_deg).max(to_deg.abs() + 2.0 * off_deg))
    }

    /// The clear position where the rotary stage was read back.
    pub(crate) fn clear_mm(&self, tilt_deg: f64) -> f64 {
        self.edge_mm(tilt_deg.abs() + self.rotary.tolerance_deg)
    }

    fn edge_mm(&self, steepest: f64) -> f64 {
        let Geometry { surface_above_pivot_mm, sample_half_width_mm, .. } = self.geometry;
        let height = surface_above_pivot_mm + self.geometry.surface_tolerance_mm;
        let radius = height.hypot(sample_half_width_mm);
        let elevation = height.atan2(sample_half_width_mm);
        let angle = (elevation + steepest.to_radians()).min(std::f64::consts::FRAC_PI_2);
        let corner = radius * angle.max(elevation).sin();
        let edge = self.geometry.surface_mm - surface_above_pivot_mm + corner;
        (edge + TURN_ROOM_MM).min(self.linear.clear_mm)
    }

    /// The largest distance of a surface from where geometry puts it, mm.
    pub(crate) const fn surface_tolerance_mm(&self) -> f64 {
        self.geometry.surface_tolerance_mm
    }

    /// The lowest height that any touch may need at this tilt, mm.
    pub(crate) fn floor_mm(&self, tilt_deg: f64) -> f64 {
        let below = self.geometry.surface_tolerance_mm + self.limits.max_indentation_mm;
        self.surface_mm(tilt_deg) - below
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Protocol {
    pub(crate) name: Option<String>,
    seed: Option<toml::Value>,
    pub(crate) samples: Vec<String>,
    pub(crate) directions: Vec<String>,
    pub(crate) angles_deg: Vec<f64>,
    pub(crate) order: Option<String>,
    pub(crate) no_load: Option<String>,
    pub(crate) aim: Option<AimKeys>,
    #[serde(default = "one")]
    pub(crate) repeats: u32,
    pub(crate) touch: TouchKeys,
    pub(crate) approach: Approach,
    pub(crate) no_load_sweep: SweepKeys,
    pub(crate) contact_sweep: SweepKeys,
    pub(crate) blind: Option<Blind>,
    #[serde(default)]
    pub(crate) limits: ProtocolLimits,
}

impl Protocol {
    /// The seed of every random choice; `None` if it is not a whole number.
    pub(crate) fn seed(&self) -> Option<i64> {
        self.seed.as_ref().map_or(Some(1), toml::Value::as_integer)
    }

    /// Whether the drift says when the reference is measured again.
    pub(crate) fn is_by_drift(&self) -> bool {
        self.no_load.as_deref() == Some("by-drift")
    }
}

const fn one() -> u32 {
    1
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct TouchKeys {
    pub(crate) indentation_mm: f64,
    pub(crate) halfway_mm: Option<f64>,
    #[serde(default)]
    pub(crate) dwell_s: f64,
    on_refusal: Option<String>,
}

impl TouchKeys {
    /// Whether a run ends with a refused touch.
    pub(crate) fn ends_with_refusal(&self) -> bool {
        self.on_refusal.as_deref() == Some("abort")
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Approach {
    pub(crate) give_up_below_mm: f64,
    pub(crate) coarse_step_mm: f64,
    pub(crate) start_above_mm: Option<f64>,
    /// Of the file, or chosen for its aim.
    pub(crate) fine_step_mm: Option<f64>,
    pub(crate) contact_threshold: f64,
    #[serde(default)]
    pub(crate) settle_s: f64,
    #[serde(default)]
    pub(crate) cycles: u32,
    slip_mm: Option<f64>,
    /// "descent" for one before the search in steps.
    method: Option<String>,
    speed_mm_per_s: Option<f64>,
    slow_speed_mm_per_s: Option<f64>,
}

impl Approach {
    /// The speed that the protocol asks for in a step, whose name ends in the number of the touch at its pose, mm/s.
    pub(crate) fn speed_of(&self, step: &str) -> Option<f64> {
        let number = step.rsplit('/').next().and_then(|last| last.parse::<u32>().ok());
        let is_slow = number.is_some_and(|number| number % 2 == 0);
        self.slow_speed_mm_per_s.filter(|_| is_slow).or(self.speed_mm_per_s)
    }

    /// Whether surfaces are found by descents.
    pub(crate) fn is_by_descent(&self) -> bool {
        self.method.as_deref() == Some("descent")
    }
}

/// The section `[aim]` of a protocol.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct AimKeys {
    pub(crate) stiffness_percent: Option<f64>,
    pub(crate) seconds_per_touch: Option<f64>,
}

impl Approach {
    /// The last step of the search, mm. Without any, no bracket of a surface is narrow enough.
    pub(crate) fn fine_step_mm(&self) -> f64 {
        self.fine_step_mm.unwrap_or(0.0)
    }
}

impl Protocol {
    /// The distance from the surface at which it is looked for again after a sweep, mm; `None` if it is
    /// not.
    pub(crate) fn slip_mm(&self) -> Option<f64> {
        let usual = (self.touch.indentation_mm / 20.0).max(self.approach.fine_step_mm());
        Some(self.approach.slip_mm.unwrap_or(usual)).filter(|slip| *slip > 0.0)
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct SweepKeys {
    pub(crate) min_hz: f64,
    pub(crate) max_hz: f64,
    pub(crate) target_sigma_hz: Option<f64>,
    pub(crate) level_v: Option<f64>,
    #[serde(default)]
    method: String,
    points: Option<u32>,
    pub(crate) survey_s: Option<u32>,
    /// Whether the level is checked after the survey.
    #[serde(default)]
    pub(crate) level_check: bool,
}

impl SweepKeys {
    /// The number of points of a uniform sweep; `None` for another one.
    pub(crate) fn grid(&self) -> Option<u32> {
        self.points.filter(|_| self.method == "uniform" && self.survey_s.is_none())
    }

    /// What a fit knows of the times of the readings; `None` if the sweeps are of both methods.
    pub(crate) fn timing(&self) -> Option<&'static str> {
        match (&*self.method, self.survey_s) {
            ("uniform", None) => Some("waited"),
            ("uniform", Some(_)) => None,
            _ => Some("any-phase"),
        }
    }

    /// The standard deviation that is asked for, Hz; a uniform sweep has none.
    pub(crate) fn target_sigma_hz(&self) -> Option<f64> {
        self.target_sigma_hz.filter(|_| self.method != "uniform")
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Blind {
    pub(crate) trials: u32,
    order: Option<String>,
    #[serde(default)]
    pub(crate) min_angle_deg: f64,
    pub(crate) max_angle_deg: f64,
}

impl Blind {
    /// Whether the touches of one mounting are made together.
    pub(crate) fn is_by_mounting(&self) -> bool {
        self.order.as_deref() == Some("by-mounting")
    }
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct ProtocolLimits {
    pub(crate) max_indentation_mm: Option<f64>,
}

/// The settings of a run.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    pub(crate) rig: Rig,
    pub(crate) protocol: Protocol,
}

impl Settings {
    /// Reads the text of both files, and takes what the protocol leaves to its aim from the record.
    pub(crate) fn read(started: &RunStarted) -> Result<Self, toml::de::Error> {
        let mut protocol = toml::from_str(&started.protocol.toml)?;
        aim::complete(&mut protocol, started.aim.as_ref());
        Ok(Self { rig: toml::from_str(&started.rig.toml)?, protocol })
    }

    /// The deepest indentation that rig and protocol allow, mm.
    pub(crate) fn max_indentation_mm(&self) -> f64 {
        let of_rig = self.rig.limits.max_indentation_mm;
        self.protocol.limits.max_indentation_mm.map_or(of_rig, |limit| limit.min(of_rig))
    }
}

/// Where the rotary stage stands for a pose, degrees; `None` for an unknown direction.
pub(crate) fn tilt_deg(direction: &str, angle_deg: f64) -> Option<f64> {
    match direction {
        "front" | "left" => Some(angle_deg),
        "back" => Some(-angle_deg),
        _ => None,
    }
}

/// The mounting of the sensor for a direction.
pub(crate) fn orientation(direction: &str) -> Option<&'static str> {
    match direction {
        "front" | "back" => Some("front/back"),
        "left" => Some("left"),
        _ => None,
    }
}
