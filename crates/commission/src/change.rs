//! What a change of the bench voids.

use crate::Kind;

/// A change of the bench that calibrations do not see by themselves. Changes of the rig file, of a drive's address and of
/// the port are seen by the keys and the drives of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BenchChange {
    /// A drive, a motor, a coupling or a screw was exchanged, or a setting of a drive was changed.
    Drive,
    /// The emergency stop or its wiring was changed.
    Stop,
    /// A limit switch was moved or exchanged, or its wiring was changed.
    Limits,
    /// The sensor was clamped again.
    Sensor,
    /// The probe was exchanged.
    Probe,
    /// The holder of the samples was taken off.
    Holder,
    /// The probe was pressed into something, by a fault or by hand.
    Collision,
    /// The analyzer, its port, adapter or settings were exchanged.
    Analyzer,
    /// The bench was moved, or its temperature has changed by more than 3 °C.
    Place,
    /// The block or a reference sample of the daily check was exchanged.
    References,
    /// A drive has lost its zero, or a check of its homing did not end well: its zero may be at another place.
    Zero,
}

impl BenchChange {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Drive,
        Self::Stop,
        Self::Limits,
        Self::Sensor,
        Self::Probe,
        Self::Holder,
        Self::Collision,
        Self::Analyzer,
        Self::Place,
        Self::References,
        Self::Zero,
    ];

    /// Its name in commands and records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::Stop => "stop",
            Self::Limits => "limits",
            Self::Sensor => "sensor",
            Self::Probe => "probe",
            Self::Holder => "holder",
            Self::Collision => "collision",
            Self::Analyzer => "analyzer",
            Self::Place => "place",
            Self::References => "references",
            Self::Zero => "zero",
        }
    }

    /// What was changed, for a person.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Drive => {
                "a drive, motor, coupling or screw was exchanged, or a setting of a drive changed"
            }
            Self::Stop => "the emergency stop or its wiring was changed",
            Self::Limits => "a limit switch was moved or exchanged, or its wiring was changed",
            Self::Sensor => "the sensor was clamped again",
            Self::Probe => "the probe was exchanged",
            Self::Holder => "the holder of the samples was taken off",
            Self::Collision => "the probe was pressed into something",
            Self::Analyzer => "the analyzer, its port, its adapter or its settings were changed",
            Self::Place => "the bench was moved, or its temperature has changed by more than 3 °C",
            Self::References => "the block or a reference sample of the daily check was exchanged",
            Self::Zero => {
                "a drive has lost its zero, or a check of its homing was interrupted or failed"
            }
        }
    }

    /// The records that no longer hold.
    pub const fn voids(self) -> &'static [Kind] {
        match self {
            Self::Drive => &Kind::ALL,
            Self::Stop => &[Kind::Stop],
            Self::Limits => &[Kind::Limits],
            // The ball is the same one.
            Self::Sensor => {
                &[Kind::Geometry, Kind::Blocks, Kind::Touches, Kind::Sensor, Kind::Check]
            }
            Self::Probe => {
                &[Kind::Geometry, Kind::Blocks, Kind::Touches, Kind::Pin, Kind::Sensor, Kind::Check]
            }
            Self::Holder => &[Kind::Geometry, Kind::Blocks, Kind::Touches, Kind::Check],
            // The daily check goes on, and shows what they have changed.
            Self::Collision => {
                &[Kind::Geometry, Kind::Blocks, Kind::Touches, Kind::Pin, Kind::Sensor]
            }
            Self::Analyzer => &[Kind::Latency, Kind::Sensor],
            Self::Place => &[Kind::Blocks],
            Self::References => &[Kind::Check],
            Self::Zero => &[Kind::Scale, Kind::Geometry, Kind::Limits, Kind::Homing, Kind::Blocks],
        }
    }
}
