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
}

impl Step {
    /// All of them. Without an accepted record of each, a rig does not move by itself.
    pub const ALL: [Self; 4] = [Self::Stop, Self::Signs, Self::Geometry, Self::Scale];

    /// Its name in commands and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Signs => "signs",
            Self::Geometry => "geometry",
            Self::Scale => "scale",
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
            Self::Geometry => "three lengths within 0.5 mm of the rig file",
        }
    }

    /// The bench as the person sees it.
    pub const fn picture(self) -> &'static str {
        match self {
            Self::Stop => STOP,
            Self::Signs => SIGNS,
            Self::Scale => SCALE,
            Self::Geometry => GEOMETRY,
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
