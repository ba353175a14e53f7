//! Shapes of points.

use std::fmt::Write as _;

use crate::svg::Number;

/// The shape of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// A disc.
    Circle,
    /// A square.
    Square,
    /// A triangle that points up.
    Up,
    /// A diamond.
    Diamond,
    /// A triangle that points down.
    Down,
    /// A plus sign, filled.
    Plus,
    /// An oblique cross of two strokes.
    Cross,
    /// A large ring, to be drawn around another point.
    Ring,
}

impl Marker {
    /// The marker that goes with a colour.
    pub const fn of(index: usize) -> Self {
        const ALL: [Marker; crate::COLOURS] = [
            Marker::Circle,
            Marker::Square,
            Marker::Up,
            Marker::Diamond,
            Marker::Down,
            Marker::Plus,
            Marker::Cross,
        ];
        ALL[index % ALL.len()]
    }

    /// Whether it is drawn in strokes and not filled.
    pub(crate) const fn is_open(self) -> bool {
        matches!(self, Self::Cross | Self::Ring)
    }

    /// The path of the marker about a place. All filled markers have about the same area.
    pub(crate) fn path(self, (x, y): (f64, f64)) -> String {
        let polygon = |corners: &[(f64, f64)]| {
            let mut path = String::new();
            for (index, (dx, dy)) in corners.iter().enumerate() {
                let verb = if index == 0 { 'M' } else { 'L' };
                write!(path, "{verb}{} {}", Number(x + dx), Number(y + dy))
                    .expect("a string takes all text");
            }
            path + "Z"
        };
        let circle = |radius: f64| {
            let (left, top, r) = (Number(x - radius), Number(y), Number(radius));
            let across = Number(2.0 * radius);
            format!("M{left} {top}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0Z")
        };
        match self {
            Self::Circle => circle(4.2),
            Self::Square => polygon(&[(-3.7, -3.7), (3.7, -3.7), (3.7, 3.7), (-3.7, 3.7)]),
            Self::Up => polygon(&[(0.0, -5.4), (4.9, 3.4), (-4.9, 3.4)]),
            Self::Diamond => polygon(&[(0.0, -5.4), (5.0, 0.0), (0.0, 5.4), (-5.0, 0.0)]),
            Self::Down => polygon(&[(0.0, 5.4), (4.9, -3.4), (-4.9, -3.4)]),
            Self::Plus => polygon(&[
                (-1.7, -5.2),
                (1.7, -5.2),
                (1.7, -1.7),
                (5.2, -1.7),
                (5.2, 1.7),
                (1.7, 1.7),
                (1.7, 5.2),
                (-1.7, 5.2),
                (-1.7, 1.7),
                (-5.2, 1.7),
                (-5.2, -1.7),
                (-1.7, -1.7),
            ]),
            Self::Cross => {
                let (left, right) = (Number(x - 4.0), Number(x + 4.0));
                let (top, bottom) = (Number(y - 4.0), Number(y + 4.0));
                format!("M{left} {top}L{right} {bottom}M{left} {bottom}L{right} {top}")
            }
            Self::Ring => circle(8.0),
        }
    }
}
