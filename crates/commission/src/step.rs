//! The steps of commissioning, in their order.

/// A step of commissioning. Each rests on those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Step {
    /// The emergency stop keeps both axes still.
    Stop,
    /// Each axis moves in the direction that the rig file says.
    Signs,
    /// Surface and rotary axis are where the rig file says, by a rule.
    Geometry,
    /// Each axis moves as far as the rig file says, and the table is level at zero.
    Scale,
    /// Something stops each axis at the ends of its travel, outside of the soft limits.
    Limits,
    /// Each axis is where it was after its drive was without power.
    Homing,
}

impl Step {
    /// All of them. Without an accepted record of each, a rig does not move by itself.
    pub const ALL: [Self; 6] =
        [Self::Stop, Self::Signs, Self::Geometry, Self::Scale, Self::Limits, Self::Homing];

    /// Its name in commands and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Signs => "signs",
            Self::Geometry => "geometry",
            Self::Scale => "scale",
            Self::Limits => "limits",
            Self::Homing => "homing",
        }
    }

    /// What it shows.
    pub const fn shows(self) -> &'static str {
        match self {
            Self::Stop => "the emergency stop keeps both axes still",
            Self::Signs => "each axis moves in the direction that the rig file says",
            Self::Scale => {
                "each axis moves as far as the rig file says, and the table is level at 0°"
            }
            Self::Geometry => "surface and rotary axis are where the rig file says, by a rule",
            Self::Limits => {
                "each axis is stopped at the ends of its travel, outside of the soft limits"
            }
            Self::Homing => "each axis is where it was after its drive was without power",
        }
    }

    /// When it is accepted.
    pub const fn limit(self) -> &'static str {
        match self {
            Self::Stop => {
                "nothing is seen to move while the stop is pressed, and both axes after it"
            }
            Self::Signs => {
                "three answers for each axis agree with each other and with the rig file"
            }
            Self::Scale => "10 mm on a dial gauge within 0.3 %; ±30° on an angle gauge within 0.3°",
            Self::Geometry => {
                "three lengths are within 0.5 mm of the rig file, and the surface by them within surface_tolerance_mm at each tilt"
            }
            Self::Limits => {
                "three stops at an end lie within 0.05 mm or 0.3°, and the soft limits 2 mm or 2° inside of them"
            }
            Self::Homing => {
                "test indicators range over at most 0.005 mm at the carriage and 0.007 mm at the table, which is 0.02°"
            }
        }
    }

    /// The bench as the person sees it.
    pub const fn picture(self) -> &'static str {
        match self {
            Self::Stop => STOP,
            Self::Signs => SIGNS,
            Self::Scale => SCALE,
            Self::Geometry => GEOMETRY,
            Self::Limits => LIMITS,
            Self::Homing => HOMING,
        }
    }
}

const STOP: &str = "
      ___            power ──▶ ( stop ) ──▶ both motors
     ( O )  press
    ──┴─┴──          pressed: nothing turns, whatever is sent";

const SIGNS: &str = "
      ▲ up       clamp ═══════╤═ tip of the bimorph
      │                       o   probe
      ▼ down
                 ─────────────┬─────────────  table
                 this edge?   ⊙    or this one?";

const SCALE: &str = "
      ┌──────┐ dial gauge, against the carriage of the probe
      │  0   │
      └──┬───┘       angle gauge or square, on the table
         ▼           ┌───┐
     ▒▒▒▒▒▒▒▒▒       │ ∠ │
      carriage   ────┴───┴────────⊙─────────";

const GEOMETRY: &str = "
           o  tip
           ┊  gap
     ▒▒▒▒▒▒▒▒▒▒▒▒▒  surface of a level sample
           ┊  height above the axis
     ──────┊──⊙───
           └──┘  probe beside the axis, positive towards the tip of the bimorph";

const LIMITS: &str = "
     ─┬─ ▣ limit switch at the upper end: the probe drives into it
      │  ┄ upper soft limit, at least 2 mm below
      o  probe
      │  ┄ lower soft limit
     ─┴─ ▣ limit switch at the lower end: pressed by hand, and measured by a rule

     ▣ ╲      ╱ ▣   the empty table turns into both of its switches
        ╲─⊙─╱";

const HOMING: &str = "
      ┌──────┐ test indicator with divisions of 1 µm, against the carriage
      │  0   │                      ┌──────┐ a second one, against the
      └──┬───┘                      │  0   │ edge of the table, 20 mm
         ▼                          └──┬───┘ from its axis
     ▒▒▒▒▒▒▒▒▒                         ▼
      carriage            ──────⊙──────────
     both drives: power off, and on again";
