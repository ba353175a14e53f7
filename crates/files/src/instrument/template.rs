//! Messages of an instrument file, with places for the quantities of a measurement.

use rig_scpi::{Ending, Program, shortest};

/// A quantity that a message can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Amplitude of the level, V.
    Level,
    /// Frequency, Hz.
    Frequency,
    /// Number of measurements that one trigger averages.
    Averages,
    /// Time between trigger and measurement, s.
    Delay,
    /// Length of the cable, m.
    Cable,
}

impl Quantity {
    /// Every quantity.
    const ALL: [Self; 5] = [Self::Level, Self::Frequency, Self::Averages, Self::Delay, Self::Cable];

    /// The word between braces in a message.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Level => "level_v",
            Self::Frequency => "frequency_hz",
            Self::Averages => "averages",
            Self::Delay => "delay_s",
            Self::Cable => "cable_m",
        }
    }
}

/// A message: commands and questions, each counted from the root of the command tree.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Template {
    /// The units of the message, in order.
    pub units: Vec<TemplateUnit>,
}

/// One command or question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TemplateUnit {
    /// The header, without the mark of a question.
    pub header: String,
    /// Whether it is a question.
    pub is_question: bool,
    /// Its data; each is put together of pieces.
    pub data: Vec<Vec<Piece>>,
}

/// A piece of a datum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Piece {
    /// As it is written in the file.
    Text(String),
    /// The value of a quantity, in the shortest decimal form or with this number of decimals.
    Value {
        /// The quantity.
        quantity: Quantity,
        /// Digits behind the decimal point; `None` for the shortest form.
        decimals: Option<usize>,
    },
}

/// Why a text is no message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum TemplateFault {
    #[error("`{0}` is not a header of IEEE 488.2")]
    Header(String),
    #[error("`{0}` is not one datum of printable ASCII characters without quotation marks")]
    Datum(String),
    #[error("`{{{0}}}` is not a quantity of this message")]
    Quantity(String),
    #[error("`{0}` has a brace without its partner")]
    Brace(String),
    #[error("it has no command or question")]
    Empty,
}

/// The most decimals of a value: a double has no more.
const DECIMALS_MAX: usize = 15;

impl Template {
    /// Reads a message such as `:LEVel V;:LEVel:VOLTage {level_v}`, with these quantities.
    pub(super) fn parse(text: &str, allowed: &[Quantity]) -> Result<Self, TemplateFault> {
        let units = text.split(';').map(str::trim).filter(|unit| !unit.is_empty());
        let units: Vec<_> =
            units.map(|unit| parse_unit(unit, allowed)).collect::<Result<_, _>>()?;
        if units.is_empty() { Err(TemplateFault::Empty) } else { Ok(Self { units }) }
    }

    /// Whether the message holds this quantity.
    pub fn holds(&self, wanted: Quantity) -> bool {
        let pieces = self.units.iter().flat_map(|unit| unit.data.iter().flatten());
        pieces
            .into_iter()
            .any(|piece| matches!(piece, Piece::Value { quantity, .. } if *quantity == wanted))
    }

    /// Number of questions in the message.
    pub fn n_questions(&self) -> usize {
        self.units.iter().filter(|unit| unit.is_question).count()
    }
}

/// The text of a datum, with the values of its quantities.
pub fn datum(pieces: &[Piece], value: impl Fn(Quantity) -> f64) -> String {
    let piece = |piece: &Piece| match piece {
        Piece::Text(text) => text.clone(),
        Piece::Value { quantity, decimals: None } => shortest(value(*quantity)),
        Piece::Value { quantity, decimals: Some(decimals) } => {
            format!("{:.decimals$}", value(*quantity))
        }
    };
    pieces.iter().map(piece).collect()
}

fn parse_unit(text: &str, allowed: &[Quantity]) -> Result<TemplateUnit, TemplateFault> {
    let (head, data) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let (header, is_question) = head.strip_suffix('?').map_or((head, false), |head| (head, true));
    if Program::command(header).finish(Ending::Lf).is_err() {
        return Err(TemplateFault::Header(header.to_owned()));
    }
    let data = data.trim();
    let data = if data.is_empty() {
        Vec::new()
    } else {
        data.split(',').map(|one| parse_datum(one.trim(), allowed)).collect::<Result<_, _>>()?
    };
    Ok(TemplateUnit { header: header.to_owned(), is_question, data })
}

fn parse_datum(text: &str, allowed: &[Quantity]) -> Result<Vec<Piece>, TemplateFault> {
    let (mut pieces, mut rest) = (Vec::new(), text);
    while !rest.is_empty() {
        let Some((before, behind)) = rest.split_once('{') else {
            pieces.push(Piece::Text(rest.to_owned()));
            break;
        };
        if !before.is_empty() {
            pieces.push(Piece::Text(before.to_owned()));
        }
        let (inside, after) =
            behind.split_once('}').ok_or_else(|| TemplateFault::Brace(text.to_owned()))?;
        pieces.push(parse_value(inside, allowed)?);
        rest = after;
    }
    let is_closed =
        !pieces.iter().any(|piece| matches!(piece, Piece::Text(text) if text.contains('}')));
    if !is_closed {
        return Err(TemplateFault::Brace(text.to_owned()));
    }
    let example = datum(&pieces, |_| 1.0);
    if Program::command("X").literal(&example).finish(Ending::Lf).is_err() {
        return Err(TemplateFault::Datum(text.to_owned()));
    }
    Ok(pieces)
}

/// A quantity with its form: `level_v`, or `level_v:.3` for three decimals.
fn parse_value(inside: &str, allowed: &[Quantity]) -> Result<Piece, TemplateFault> {
    let refused = || TemplateFault::Quantity(inside.to_owned());
    let (word, decimals) = match inside.split_once(":.") {
        None => (inside, None),
        Some((word, digits)) => {
            let decimals = digits.parse().ok().filter(|digits| *digits <= DECIMALS_MAX);
            (word, Some(decimals.ok_or_else(refused)?))
        }
    };
    let quantity = Quantity::ALL.into_iter().find(|quantity| quantity.word() == word);
    let quantity = quantity.filter(|quantity| allowed.contains(quantity)).ok_or_else(refused)?;
    Ok(Piece::Value { quantity, decimals })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_read_into_units_with_their_data() {
        let template = Template::parse(
            ":APERture SHORt,{averages};:FREQ {frequency_hz:.2}HZ; *IDN?",
            &Quantity::ALL,
        )
        .unwrap();
        let headers: Vec<_> = template.units.iter().map(|unit| unit.header.as_str()).collect();
        assert_eq!(headers, [":APERture", ":FREQ", "*IDN"]);
        assert_eq!(template.n_questions(), 1);
        assert!(template.holds(Quantity::Averages) && !template.holds(Quantity::Level));
        let shown = |unit: usize, at: usize| datum(&template.units[unit].data[at], |_| 140.0);
        assert_eq!([shown(0, 0), shown(0, 1), shown(1, 0)], ["SHORt", "140", "140.00HZ"]);
    }

    #[test]
    fn what_is_no_message_is_refused_with_the_part_at_fault() {
        #[track_caller]
        fn check(text: &str, expected: &str) {
            let found = Template::parse(text, &[Quantity::Level]).unwrap_err();
            assert_eq!(found.to_string(), expected);
        }
        check(" ; ", "it has no command or question");
        check("1A", "`1A` is not a header of IEEE 488.2");
        check(":A {volt}", "`{volt}` is not a quantity of this message");
        check(":A {frequency_hz}", "`{frequency_hz}` is not a quantity of this message");
        check(":A {level_v:.99}", "`{level_v:.99}` is not a quantity of this message");
        check(":A {level_v", "`{level_v` has a brace without its partner");
        check(":A level_v}", "`level_v}` has a brace without its partner");
        let datum =
            "`\"a\"` is not one datum of printable ASCII characters without quotation marks";
        check(":A \"a\"", datum);
    }
}
