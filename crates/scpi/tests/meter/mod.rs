//! A small meter built on the public API, for the tests that talk to it.

use std::sync::LazyLock;

use rig_scpi::{
    Call, Dialect, Instrument, Limits, Node, Param, ScpiError, Tree, Unit, Value, command, query,
    setting,
};

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Meter {
    Frequency,
    Level,
    Output,
    Source,
    Fetch,
    Label,
    Echo,
    Trigger,
    Scalar,
    Dc,
    Ac,
    Init,
    List,
}

pub(crate) const COMMANDS: &[Node<Meter>] = &[
    setting("[:SOURce]:FREQuency[:CW]", Meter::Frequency),
    setting("[:SOURce]:VOLTage[:LEVel]", Meter::Level),
    setting(":OUTPut#(1:4)[:STATe]", Meter::Output),
    setting(":TRIGger[:SEQuence]:SOURce", Meter::Source),
    query(":FETCh[:IMPedance][:FORMatted]", Meter::Fetch),
    setting(":DISPlay:LABel", Meter::Label),
    query(":ECHO", Meter::Echo).asks(0, 9),
    command("*TRG", Meter::Trigger),
    query(":CONFigure[:SCALar]", Meter::Scalar),
    query(":CONFigure[:SCALar]:VOLTage[:DC]", Meter::Dc),
    query(":CONFigure[:SCALar]:VOLTage:AC", Meter::Ac),
    setting(":INITiate[:IMMediate][:ALL]", Meter::Init).takes(0, 0),
    command(":LIST", Meter::List).takes(1, 100),
];

static TREE: LazyLock<Tree<Meter>> =
    LazyLock::new(|| Tree::new(COMMANDS).expect("no two patterns match the same header"));

const FREQUENCY: Limits = Limits { min: 20.0, max: 2e6, default: 1e3 };

pub(crate) struct Host {
    pub(crate) instrument: Instrument<Meter>,
    frequency_hz: f64,
    outputs: [bool; 4],
    label: String,
}

impl Host {
    pub(crate) fn new(dialect: Dialect) -> Self {
        let mut host = Self {
            instrument: Instrument::new(TREE.clone(), dialect),
            frequency_hz: 1e3,
            outputs: [false; 4],
            label: String::new(),
        };
        // Power-on is an event; these tests begin after it was read.
        assert!(host.say(b"*ESR?\n").starts_with(b"128"));
        host
    }

    pub(crate) fn say(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.instrument.push(bytes);
        self.run();
        self.instrument.take_output()
    }

    pub(crate) fn run(&mut self) {
        while let Some(call) = self.instrument.poll() {
            let result = self.carry_out(&call);
            self.instrument.answer(result);
        }
    }

    fn carry_out(&mut self, call: &Call<Meter>) -> Result<Vec<Value>, ScpiError> {
        let value = match (call.command, call.is_query) {
            (Meter::Frequency, false) => {
                self.frequency_hz = call.param(0)?.real(Unit::HERTZ, FREQUENCY)?;
                return Ok(vec![]);
            }
            (Meter::Frequency, true) => match call.params.first() {
                None => Value::Real(self.frequency_hz),
                Some(param) => Value::Real(param.real(Unit::HERTZ, FREQUENCY)?),
            },
            (Meter::Output, is_query) => {
                let output = &mut self.outputs[call.suffix(0) as usize - 1];
                if is_query {
                    Value::Boolean(*output)
                } else {
                    *output = call.param(0)?.boolean()?;
                    return Ok(vec![]);
                }
            }
            (Meter::Label, false) => {
                call.param(0)?.text()?.clone_into(&mut self.label);
                return Ok(vec![]);
            }
            (Meter::Label, true) => Value::Text(self.label.clone().into()),
            (Meter::Source, false) => {
                call.param(0)?.choice(&[("BUS", 0), ("IMMediate", 1)])?;
                return Ok(vec![]);
            }
            (Meter::Source, true) => Value::Characters("IMMediate"),
            (Meter::Fetch, _) => {
                return Ok(vec![
                    Value::Real(f64::NAN),
                    Value::Real(f64::INFINITY),
                    Value::Integer(-1),
                ]);
            }
            (Meter::Echo, _) => return Ok(call.params.iter().map(echo).collect()),
            (Meter::Scalar, _) => Value::Integer(1),
            (Meter::Ac, _) => Value::Integer(2),
            (Meter::Dc, _) => Value::Integer(3),
            (Meter::Init, true) => Value::Integer(0),
            (Meter::Level, true) => Value::Block(b"1\n2".to_vec()),
            (Meter::Level, false) => return Err(ScpiError::new(-221)),
            (Meter::Trigger | Meter::Init | Meter::List, false) => return Ok(vec![]),
            (Meter::Trigger | Meter::List, true) => unreachable!("the tree has no such query"),
        };
        Ok(vec![value])
    }
}

/// A parameter as text, so that rows can show it.
fn echo(param: &Param) -> Value {
    let text = match param {
        Param::Number { value, suffix: None } => format!("N{value}"),
        Param::Number { value, suffix: Some(suffix) } => format!("N{value}|{suffix}"),
        Param::NonDecimal(value) => format!("D{value}"),
        Param::Characters(word) => format!("C{word}"),
        Param::Text(text) => format!("T{}", text.escape_default()),
        Param::Block(bytes) => format!("B{}", bytes.escape_ascii()),
        Param::Expression(inside) => format!("E{inside}"),
    };
    Value::Verbatim(text.into())
}

pub(crate) fn standard() -> Dialect {
    Dialect::standard("MA,IN,0,VER")
}
