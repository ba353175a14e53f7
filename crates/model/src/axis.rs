//! Axes, their soft limits, and the targets that only an axis can make.

use std::{fmt, marker::PhantomData};

/// A unit of position. The two axes of the rig never mix, because their units are types.
pub trait Unit: Copy + fmt::Debug + PartialEq + PartialOrd + Send + Sync + 'static {
    /// The symbol that people read, such as `mm`.
    const SYMBOL: &'static str;
}

/// Millimetres, of the linear stage.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Mm;

/// Degrees, of the rotary stage.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Deg;

impl Unit for Mm {
    const SYMBOL: &'static str = "mm";
}

impl Unit for Deg {
    const SYMBOL: &'static str = "°";
}

/// A place on an axis. It may lie anywhere; only [`Axis::target`] makes it a place to go to.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Position<U>(f64, PhantomData<U>);

impl<U: Unit> Position<U> {
    /// The position with this value in the unit `U`.
    pub const fn new(value: f64) -> Self {
        Self(value, PhantomData)
    }

    /// The value in the unit `U`.
    pub const fn value(self) -> f64 {
        self.0
    }

    /// The position `distance` further along the axis, in the unit `U`.
    pub fn offset(self, distance: f64) -> Self {
        Self::new(self.0 + distance)
    }
}

impl<U: Unit> fmt::Display for Position<U> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} {}", self.0, U::SYMBOL)
    }
}

/// A closed interval of positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span<U> {
    /// The lower end.
    pub min: Position<U>,
    /// The upper end.
    pub max: Position<U>,
}

impl<U: Unit> Span<U> {
    /// The interval from `min` to `max`, in the unit `U`.
    pub const fn new(min: f64, max: f64) -> Self {
        Self { min: Position::new(min), max: Position::new(max) }
    }

    /// Whether `position` lies inside. A position that is not a number never does.
    pub fn contains(&self, position: Position<U>) -> bool {
        self.min <= position && position <= self.max
    }
}

impl<U: Unit> fmt::Display for Span<U> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}, {}]", self.min, self.max)
    }
}

/// Why an axis or a target was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AxisError<U: Unit> {
    /// The soft limits reach beyond the travel.
    #[error("{axis}: soft limits {soft} reach beyond the travel {travel}")]
    SoftBeyondTravel {
        /// Name of the axis.
        axis: &'static str,
        /// The requested soft limits.
        soft: Span<U>,
        /// The mechanical travel.
        travel: Span<U>,
    },
    /// The rest position cannot be reached.
    #[error("{axis}: rest position {rest} is outside the soft limits {soft}")]
    RestOutOfReach {
        /// Name of the axis.
        axis: &'static str,
        /// The requested rest position.
        rest: Position<U>,
        /// The soft limits.
        soft: Span<U>,
    },
    /// A span is empty, or a limit is not a positive number.
    #[error("{axis}: {what} must be a positive number, found {found}")]
    NotPositive {
        /// Name of the axis.
        axis: &'static str,
        /// The quantity at fault.
        what: &'static str,
        /// The value, in the unit of the axis.
        found: f64,
    },
    /// A target outside the soft limits.
    #[error("{axis}: target {wanted} is outside the soft limits {soft}")]
    OutsideSoftLimits {
        /// Name of the axis.
        axis: &'static str,
        /// The requested position.
        wanted: Position<U>,
        /// The soft limits.
        soft: Span<U>,
    },
}

/// The limits of an axis, before they are checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits<U> {
    /// Mechanical travel.
    pub travel: Span<U>,
    /// Soft limits, inside the travel.
    pub soft: Span<U>,
    /// Rest position: the clear position of the linear stage, level for the rotary stage.
    pub rest: Position<U>,
    /// Largest distance of a read-back from its target, in the unit `U`.
    pub tolerance: f64,
    /// The fastest move, in units per second.
    pub max_speed_per_s: f64,
}

/// One axis of the rig, checked once when the configuration is read.
///
/// Invariant: the rest position lies in the soft limits, and these lie in the travel. Therefore
/// [`Axis::rest_target`] cannot fail, and a retract never has to ask for permission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis<U> {
    name: &'static str,
    limits: AxisLimits<U>,
}

/// A position that an axis may be sent to. Only [`Axis`] makes one, and a driver takes nothing
/// else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target<U>(Position<U>);

impl<U: Unit> Target<U> {
    /// The position to go to.
    pub const fn position(self) -> Position<U> {
        self.0
    }
}

impl<U: Unit> Axis<U> {
    /// Checks the limits of an axis.
    ///
    /// # Errors
    /// [`AxisError::SoftBeyondTravel`], [`AxisError::RestOutOfReach`], or
    /// [`AxisError::NotPositive`] for an empty span, a tolerance or a speed that is not positive.
    pub fn new(name: &'static str, limits: AxisLimits<U>) -> Result<Self, AxisError<U>> {
        let AxisLimits { travel, soft, rest, tolerance, max_speed_per_s } = limits;
        let positive = [
            ("the soft range", soft.max.value() - soft.min.value()),
            ("the tolerance", tolerance),
            ("the highest speed", max_speed_per_s),
        ];
        for (what, found) in positive {
            if !(found.is_finite() && found > 0.0) {
                return Err(AxisError::NotPositive { axis: name, what, found });
            }
        }
        if !(travel.contains(soft.min) && travel.contains(soft.max)) {
            return Err(AxisError::SoftBeyondTravel { axis: name, soft, travel });
        }
        if !soft.contains(rest) {
            return Err(AxisError::RestOutOfReach { axis: name, rest, soft });
        }
        Ok(Self { name, limits })
    }

    /// The software limits.
    pub const fn soft(&self) -> Span<U> {
        self.limits.soft
    }

    /// The mechanical travel.
    pub const fn travel(&self) -> Span<U> {
        self.limits.travel
    }

    /// The fastest move, in units per second.
    pub const fn max_speed_per_s(&self) -> f64 {
        self.limits.max_speed_per_s
    }

    /// Largest distance of a read-back from its target, in the unit of the axis.
    pub const fn tolerance(&self) -> f64 {
        self.limits.tolerance
    }

    /// The only way to a target.
    ///
    /// # Errors
    /// [`AxisError::OutsideSoftLimits`]. A target is refused, never clamped, because a clamped
    /// approach measures at another place than the requested one.
    pub fn target(&self, wanted: Position<U>) -> Result<Target<U>, AxisError<U>> {
        if self.limits.soft.contains(wanted) {
            Ok(Target(wanted))
        } else {
            let soft = self.limits.soft;
            Err(AxisError::OutsideSoftLimits { axis: self.name, wanted, soft })
        }
    }

    /// A step from where the axis stands, for commissioning. The soft limits do not hold for it, because they
    /// are in units that are not shown yet; what admits the step bounds its length.
    ///
    /// # Errors
    /// [`AxisError::NotPositive`] if its length is not a number.
    pub fn step(&self, from: Position<U>, by: f64) -> Result<Target<U>, AxisError<U>> {
        if by.is_finite() {
            return Ok(Target(from.offset(by)));
        }
        Err(AxisError::NotPositive { axis: self.name, what: "the length of a step", found: by })
    }

    /// The place to wait. Infallible by the invariant of the type.
    pub const fn rest_target(&self) -> Target<U> {
        Target(self.limits.rest)
    }

    /// Whether the axis can be where a read-back says it is: within its travel, or beyond by no more
    /// than the tolerance.
    pub fn can_be_at(&self, read_back: Position<U>) -> bool {
        let AxisLimits { travel, tolerance, .. } = self.limits;
        travel.contains(read_back.offset(tolerance))
            || travel.contains(read_back.offset(-tolerance))
    }

    /// Whether a read-back shows the axis at the target.
    pub fn is_at(&self, read_back: Position<U>, target: Target<U>) -> bool {
        (read_back.value() - target.0.value()).abs() <= self.limits.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> AxisLimits<Mm> {
        AxisLimits {
            travel: Span::new(0.0, 50.0),
            soft: Span::new(0.5, 49.5),
            rest: Position::new(40.0),
            tolerance: 0.002,
            max_speed_per_s: 10.0,
        }
    }

    #[test]
    fn a_target_at_the_limit_is_taken_and_one_beyond_is_refused_by_name() {
        let axis = Axis::new("linear stage", limits()).unwrap();
        assert_eq!(axis.target(Position::new(0.5)).unwrap().position().value(), 0.5);
        let refusal = axis.target(Position::new(49.501)).unwrap_err().to_string();
        assert_eq!(
            refusal,
            "linear stage: target 49.501 mm is outside the soft limits [0.500 mm, 49.500 mm]"
        );
        assert!(axis.target(Position::new(f64::NAN)).is_err());
    }

    #[test]
    fn an_axis_is_not_beyond_its_travel() {
        let axis = Axis::new("linear stage", limits()).unwrap();
        let can_be_at = |mm| axis.can_be_at(Position::new(mm));
        assert!([-0.0019, 0.0, 25.0, 50.0, 50.0019].into_iter().all(can_be_at));
        assert!(
            ![-40.0, -0.0021, 50.0021, 400.0, f64::NAN, f64::INFINITY].into_iter().any(can_be_at)
        );
    }

    #[test]
    fn an_axis_that_could_not_retract_is_refused() {
        let rest = Position::new(49.6);
        let refusal = Axis::new("linear stage", AxisLimits { rest, ..limits() });
        assert!(matches!(refusal, Err(AxisError::RestOutOfReach { .. })), "{refusal:?}");
        let soft = Span::new(0.5, 50.1);
        let refusal = Axis::new("linear stage", AxisLimits { soft, ..limits() });
        assert!(matches!(refusal, Err(AxisError::SoftBeyondTravel { .. })), "{refusal:?}");
        let refusal = Axis::new("linear stage", AxisLimits { tolerance: 0.0, ..limits() });
        assert!(matches!(refusal, Err(AxisError::NotPositive { .. })), "{refusal:?}");
    }
}
