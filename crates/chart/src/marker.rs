//! Shapes of points.

use std::fmt::Write as _;

use crate::svg::{Coordinate, Escaped, Svg};

/// Number of colours; larger indices start again at 0.
pub const COLOURS: usize = 7;

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
    /// A large ring around another point.
    Ring,
}

impl Marker {
    /// The marker of a colour.
    pub const fn of(index: usize) -> Self {
        const ALL: [Marker; COLOURS] = [
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

    /// Draws the marker at a position.
    pub(crate) fn draw(self, svg: &mut Svg, colour: usize, at: (f64, f64), note: Option<&str>) {
        let path = self.path(at);
        let class =
            if self.is_open() { format!("open s{colour}") } else { format!("mark f{colour}") };
        match note {
            Some(note) => svg.add(format_args!(
                "<path class=\"{class}\" d=\"{path}\"><title>{}</title></path>\n",
                Escaped(note)
            )),
            None => svg.add(format_args!("<path class=\"{class}\" d=\"{path}\"/>\n")),
        }
    }

    /// Whether it is drawn in strokes and not filled.
    const fn is_open(self) -> bool {
        matches!(self, Self::Cross | Self::Ring)
    }

    /// The path of the marker about a position. All filled markers have about the same area.
    fn path(self, (x, y): (f64, f64)) -> String {
        let polygon = |corners: &[(f64, f64)]| {
            let mut path = String::new();
            for (index, (dx, dy)) in corners.iter().enumerate() {
                let verb = if index == 0 { 'M' } else { 'L' };
                write!(path, "{verb}{} {}", Coordinate(x + dx), Coordinate(y + dy))
                    .expect("a string takes all text");
            }
            path + "Z"
        };
        let circle = |radius: f64| {
            let (left, top, r) = (Coordinate(x - radius), Coordinate(y), Coordinate(radius));
            let across = Coordinate(2.0 * radius);
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
                let (left, right) = (Coordinate(x - 4.0), Coordinate(x + 4.0));
                let (top, bottom) = (Coordinate(y - 4.0), Coordinate(y + 4.0));
                format!("M{left} {top}L{right} {bottom}M{left} {bottom}L{right} {top}")
            }
            Self::Ring => circle(8.0),
        }
    }
}
