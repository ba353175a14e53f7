//! An IM3536 as these tests understand its manual.

use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

use crate::peer::{Instrument, Reaction};

/// The instrument and its load. Clones share one instrument.
#[derive(Debug, Clone)]
pub(crate) struct Im3536 {
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    identity: &'static str,
    has_header: bool,
    frequency_hz: f64,
    averages: f64,
    delay_s: f64,
    level_v: f64,
    is_external: bool,
    event_status: u8,
    reading: Option<String>,
    /// A query that is followed by another unit is an error on some instruments.
    refuses_chains: bool,
    /// The status field of the next readings.
    status: u8,
    /// The most averages it takes.
    averages_max: f64,
    seen: Vec<String>,
}

/// The impedance of the sample, which depends on the frequency: resistance and reactance.
pub(crate) fn impedance(frequency_hz: f64) -> (f64, f64) {
    (1000.0 + frequency_hz, -1e6 / frequency_hz)
}

impl Im3536 {
    pub(crate) fn new() -> Self {
        let state = State::at_power_on("HIOKI,IM3536,190512345,V1.10");
        Self { state: Arc::new(Mutex::new(state)) }
    }

    pub(crate) fn that_refuses_chains() -> Self {
        let instrument = Self::new();
        instrument.state.lock().unwrap().refuses_chains = true;
        instrument
    }

    pub(crate) fn become_another(&self, identity: &'static str) {
        self.state.lock().unwrap().identity = identity;
    }

    /// It takes no averages any more.
    pub(crate) fn refuse_averages(&self) {
        self.state.lock().unwrap().averages_max = 1.0;
    }

    pub(crate) fn set_status(&self, status: u8) {
        self.state.lock().unwrap().status = status;
    }

    pub(crate) fn seen(&self) -> Vec<String> {
        self.state.lock().unwrap().seen.clone()
    }

    pub(crate) fn level_v(&self) -> f64 {
        self.state.lock().unwrap().level_v
    }
}

impl Instrument for Im3536 {
    fn message(&mut self, message: &str) -> Reaction {
        let mut state = self.state.lock().unwrap();
        state.seen.push(message.to_owned());
        let mut busy = Duration::ZERO;
        let mut answers = Vec::new();
        let units: Vec<&str> = message.split(';').collect();
        for (n, unit) in units.iter().enumerate() {
            if unit.ends_with('?') && n + 1 < units.len() && state.refuses_chains {
                state.event_status |= 1 << 2;
                break;
            }
            match state.unit(unit, &mut busy) {
                Ok(None) => {}
                Ok(Some(answer)) if state.has_header && !unit.starts_with('*') => {
                    answers.push(format!("{} {answer}", unit.trim_end_matches('?').to_uppercase()));
                }
                Ok(Some(answer)) => answers.push(answer),
                Err(bit) => {
                    state.event_status |= 1 << bit;
                    break;
                }
            }
        }
        let answer = (!answers.is_empty()).then(|| answers.join(";"));
        Reaction { busy, answer }
    }

    fn restart(&mut self) {
        let mut state = self.state.lock().unwrap();
        let seen = std::mem::take(&mut state.seen);
        let refuses_chains = state.refuses_chains;
        *state = State { refuses_chains, seen, ..State::at_power_on(state.identity) };
    }
}

const COMMAND_ERROR: u8 = 5;
const EXECUTION_ERROR: u8 = 4;

impl State {
    fn at_power_on(identity: &'static str) -> Self {
        Self {
            identity,
            has_header: true,
            frequency_hz: 1000.0,
            averages: 1.0,
            delay_s: 0.0,
            level_v: 1.0,
            is_external: false,
            event_status: 0x80,
            reading: None,
            refuses_chains: false,
            status: 0,
            averages_max: 256.0,
            seen: Vec::new(),
        }
    }

    /// Carries out one unit and returns its answer, or the bit of its error.
    fn unit(&mut self, unit: &str, busy: &mut Duration) -> Result<Option<String>, u8> {
        let (header, data) = unit.split_once(' ').unwrap_or((unit, ""));
        let number = || data.parse::<f64>().map_err(|_| COMMAND_ERROR);
        let between = |value: f64, min: f64, max: f64| {
            if (min..=max).contains(&value) { Ok(value) } else { Err(EXECUTION_ERROR) }
        };
        match header {
            "*IDN?" => return Ok(Some(self.identity.to_owned())),
            "*CLS" => self.event_status = 0,
            "*ESR?" => return Ok(Some(std::mem::take(&mut self.event_status).to_string())),
            ":HEADer" => self.has_header = data == "ON",
            ":MODE" | ":PARameter1" | ":PARameter2" | ":PARameter3" | ":PARameter4" => {}
            ":SPEEd" | ":RANGe:AUTO" | ":LEVel" | ":MEASure:VALid" => {}
            ":TRIGger" => self.is_external = data == "EXTernal",
            ":LEVel:VOLTage" => self.level_v = between(number()?, 0.01, 5.0)?,
            ":LEVel:VOLTage?" => return Ok(Some(format!("{:.3}", self.level_v))),
            ":FREQuency" => {
                self.frequency_hz = (between(number()?, 4.0, 8e6)? * 100.0).round() / 100.0;
            }
            ":FREQuency?" => return Ok(Some(format!("{:.4E}", self.frequency_hz))),
            ":AVERaging" => self.averages = between(number()?, 1.0, self.averages_max)?,
            ":TRIGger:DELay" => self.delay_s = between(number()?, 0.0, 9.9999)?,
            "*TRG" if self.is_external => {
                let integration_s = self.averages / self.frequency_hz;
                *busy += Duration::from_secs_f64(self.delay_s + integration_s + 0.002);
                let (resistance, reactance) = impedance(self.frequency_hz);
                let values = match self.status {
                    2 => "**********,**********".to_owned(),
                    _ => format!("{resistance:.8E},{reactance:.8E}"),
                };
                self.reading = Some(format!("{},{values}", self.status));
            }
            "*TRG" => return Err(EXECUTION_ERROR),
            ":MEASure?" => return self.reading.take().map(Some).ok_or(2),
            _ => return Err(COMMAND_ERROR),
        }
        Ok(None)
    }
}
