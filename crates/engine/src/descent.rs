//! Finds the surface by a continuous descent.
//!
//! ```text
//! go to above ─▶ go down evenly, read without a pause ─▶ stop ─▶ read at rest ─▶ fit ─▶ found
//!                      ▲      a contact, no readings,              │ clear        │
//!                      │      or the lowest position               │              │ not determined
//!                      └───────────────────────────────────────────┘              ▼
//!                          a false alarm, a few times at most           given up: search in steps
//! ```
//!
//! The target of the way down is the lowest position that the search in steps may reach, so that no late reading
//! and no lost stop lets the probe go deeper than was declared.

mod way;

use std::time::Duration;

use rig_model::{
    Impedance, Mm, PointResult, Position, Reading, ReadingStream, RigTime, SweepPoint,
};
use rig_protocol::Approach;
use rig_resonance::{ContactWatch, Latency, Onset, Resonance, Watched};

use crate::{
    ContactSenseFault, Fault, Surface,
    contact_sense::check_alive,
    search::{Near, relative_change},
};

/// Number of readings at rest after the stop. They show whether the probe touches.
const REST_READINGS: usize = 3;

/// The probe touches at rest if the last of them has changed by this part of the contact threshold. The vibration of a
/// light contact has only begun to grow, and the noise alone changes as much in one of twenty readings.
const REST_PART: f64 = 1.0 / 3.0;

/// Alarms without a contact after which the descent goes on.
const FALSE_ALARMS_MAX: u32 = 2;

/// Why the way down ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DescentEnd {
    /// A reading showed a contact.
    Contact,
    /// The probe arrived at its target without a contact.
    Target,
    /// No reading came for longer than the probe may go down without one.
    Late,
    /// rigd was held up.
    HeldUp,
    /// The analyzer flagged a reading.
    Flagged,
    /// Two readings were equal in every digit.
    Frozen,
    /// The readings at the beginning are not those of the clear probe before.
    NotClear,
    /// The stream broke off.
    BrokenOff,
}

impl DescentEnd {
    /// The word in the journal.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Contact => "contact",
            Self::Target => "target",
            Self::Late => "late",
            Self::HeldUp => "held_up",
            Self::Flagged => "flagged",
            Self::Frozen => "frozen",
            Self::NotClear => "not_clear",
            Self::BrokenOff => "broken_off",
        }
    }
}

/// A way down with its readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Descended {
    /// The lowest position that it could have reached.
    pub target: Position<Mm>,
    /// Its speed, mm/s.
    pub speed_mm_per_s: f64,
    /// The position after it.
    pub read_back: Position<Mm>,
    /// Why it ended.
    pub end: DescentEnd,
    /// Positions on the way with their times.
    pub way: Vec<(RigTime, Position<Mm>)>,
    /// The readings, in order.
    pub readings: Vec<Reading>,
}

/// What comes of the stream of a descent.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Streamed {
    Reading(Reading),
    /// No reading in time.
    Nothing,
    /// rigd was held up, so that the times of the readings are not known.
    HeldUp,
}

/// What follows from a reading of the stream, or from its absence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Vigil {
    /// The next reading must come by then.
    Until(RigTime),
    /// The descent must end now.
    Halt,
}

/// The next step of a descent.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum DescentStep {
    /// Go here, then call [`Descent::arrived`].
    MoveTo(Position<Mm>),
    /// Go down to here with a stream of readings, then call [`Descent::ended`].
    GoDown(Position<Mm>),
    /// Read at rest, then call [`Descent::read_at_rest`].
    ReadAtRest(usize),
    /// The surface is found, and this is the fit that shows it.
    Found(Surface, Onset),
    /// Neither the surface nor a fault is found: the search in steps follows.
    GiveUp(String),
    /// The search cannot continue.
    Fault(Fault),
}

/// What a descent needs to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DescentSetting<'a> {
    pub(crate) approach: &'a Approach,
    pub(crate) expected: Position<Mm>,
    /// The lowest position that may be asked for.
    pub(crate) floor: Position<Mm>,
    /// No surface lies higher.
    pub(crate) highest: Position<Mm>,
    /// Where the touches before expect the surface.
    pub(crate) near: Option<Near>,
    pub(crate) speed_mm_per_s: f64,
    /// The point that is read, and how long a reading takes, s.
    pub(crate) point: SweepPoint,
    pub(crate) reading_s: f64,
    pub(crate) stream: ReadingStream,
    /// The impedance of the clear probe before the descent.
    pub(crate) baseline: Impedance,
}

/// A descent, without a clock and without devices.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Descent {
    no_load: Resonance,
    expected: Position<Mm>,
    floor: Position<Mm>,
    speed_mm_per_s: f64,
    threshold: f64,
    sigma_max_mm: f64,
    latency: Latency,
    baseline: Impedance,
    /// Longest time without a reading, and the same at the beginning.
    silence: Duration,
    first_silence: Duration,
    /// The time of one reading.
    reading: Duration,
    watch: ContactWatch,
    end: Option<DescentEnd>,
    from: Position<Mm>,
    here: Position<Mm>,
    readings: Vec<Reading>,
    way: Vec<(RigTime, Position<Mm>)>,
    /// Readings at rest after the last stop.
    rest: Vec<(Position<Mm>, Reading)>,
    alarms_left: u32,
}

impl Descent {
    /// Begins a descent above every surface that is expected.
    pub(crate) fn begin(setting: &DescentSetting<'_>, no_load: &Resonance) -> (Self, DescentStep) {
        let &DescentSetting { approach, expected, floor, highest, near, speed_mm_per_s, .. } =
            setting;
        let cycles = setting.point.cycles;
        let ReadingStream { latency_s, latency_sigma_s, .. } = setting.stream;
        // The first readings are those of the clear probe, before any surface can be met.
        let references_s = (ContactWatch::references() + 1) as f64 * setting.reading_s;
        let surface = near.map_or(highest, |near| near.start);
        let begin = surface.offset(speed_mm_per_s * references_s);
        let begin = if begin < highest { highest } else { begin };
        let silence_s = approach.coarse_step_mm / speed_mm_per_s;
        let descent = Self {
            no_load: *no_load,
            expected,
            floor,
            speed_mm_per_s,
            threshold: approach.contact_threshold,
            sigma_max_mm: approach.fine_step_mm,
            latency: Latency { mean_s: latency_s, sigma_s: latency_sigma_s },
            baseline: setting.baseline,
            silence: Duration::from_secs_f64(silence_s),
            first_silence: Duration::from_secs_f64(silence_s + references_s),
            reading: Duration::from_secs_f64(setting.reading_s),
            watch: ContactWatch::new(no_load, cycles.into(), approach.contact_threshold),
            end: None,
            from: begin,
            here: begin,
            readings: Vec::new(),
            way: Vec::new(),
            rest: Vec::new(),
            alarms_left: FALSE_ALARMS_MAX,
        };
        (descent, DescentStep::MoveTo(begin))
    }

    /// The probe is where the descent begins.
    pub(crate) fn arrived(&mut self, read_back: Position<Mm>) -> DescentStep {
        self.here = read_back;
        self.go_down()
    }

    /// Goes down from here. The readings of the clear probe are those of the first time.
    pub(crate) fn go_down(&mut self) -> DescentStep {
        self.from = self.here;
        self.end = None;
        self.readings.truncate(ContactWatch::references());
        self.rest.clear();
        DescentStep::GoDown(self.floor)
    }

    /// The speed on the way down, mm/s.
    pub(crate) const fn speed_mm_per_s(&self) -> f64 {
        self.speed_mm_per_s
    }

    /// By when the first reading must come of a descent that begins now.
    pub(crate) fn begins(&self, now: RigTime) -> RigTime {
        now + self.first_silence
    }

    pub(crate) fn streamed(&mut self, now: RigTime, streamed: Streamed) -> Vigil {
        match streamed {
            Streamed::Reading(reading) => self.read(now, reading),
            Streamed::Nothing => self.halt(DescentEnd::Late),
            Streamed::HeldUp => self.halt(DescentEnd::HeldUp),
        }
    }

    /// A reading of the stream has come.
    fn read(&mut self, now: RigTime, reading: Reading) -> Vigil {
        let before = self.readings.last().map(|last| last.measured);
        self.readings.push(reading);
        if self.end.is_some() {
            return Vigil::Halt;
        }
        let PointResult::Value(impedance) = reading.measured else {
            return self.halt(DescentEnd::Flagged);
        };
        if let Some(PointResult::Value(before)) = before
            && check_alive(&self.no_load, reading.frequency_hz, before, impedance).is_err()
        {
            return self.halt(DescentEnd::Frozen);
        }
        let seen = self.watch.read(impedance);
        let reference = self.watch.reference().filter(|_| seen == Watched::Reference);
        if reference.is_some_and(|found| self.threshold < relative_change(self.baseline, found)) {
            return self.halt(DescentEnd::NotClear);
        }
        if seen == Watched::Contact {
            return self.halt(DescentEnd::Contact);
        }
        Vigil::Until(now + self.silence)
    }

    fn halt(&mut self, end: DescentEnd) -> Vigil {
        self.end = Some(self.end.unwrap_or(end));
        Vigil::Halt
    }

    /// The probe is at rest.
    pub(crate) fn ended(
        &mut self,
        at: Position<Mm>,
        way: Vec<(RigTime, Position<Mm>)>,
        tolerance_mm: f64,
    ) -> (Descended, DescentStep) {
        let is_there = (at.value() - self.floor.value()).abs() <= tolerance_mm;
        let otherwise = if is_there { DescentEnd::Target } else { DescentEnd::BrokenOff };
        let end = self.end.unwrap_or(otherwise);
        (self.here, self.way) = (at, way);
        let descended = Descended {
            target: self.floor,
            speed_mm_per_s: self.speed_mm_per_s,
            read_back: at,
            end,
            way: self.way.clone(),
            readings: self.readings.clone(),
        };
        self.end = Some(end);
        let frequency_hz = self.no_load.resonance_hz;
        let step = match end {
            DescentEnd::Contact | DescentEnd::Target => DescentStep::ReadAtRest(REST_READINGS),
            DescentEnd::Frozen => {
                DescentStep::Fault(Fault::ContactSense(ContactSenseFault::Frozen { frequency_hz }))
            }
            DescentEnd::Late => DescentStep::GiveUp(format!(
                "no reading came for {:.0} ms, in which the probe goes down by a coarse step",
                self.silence.as_secs_f64() * 1e3
            )),
            DescentEnd::HeldUp => DescentStep::GiveUp("rigd was held up".to_owned()),
            DescentEnd::Flagged => {
                DescentStep::GiveUp("the analyzer flags its readings".to_owned())
            }
            DescentEnd::NotClear => DescentStep::GiveUp(
                "the first readings of the descent are not those of the clear probe before it"
                    .to_owned(),
            ),
            DescentEnd::BrokenOff => {
                DescentStep::GiveUp("the stream of readings broke off".to_owned())
            }
        };
        (descended, step)
    }

    /// The readings at rest with their position.
    pub(crate) fn trail(&self) -> &[(Position<Mm>, Reading)] {
        &self.rest
    }

    /// Where the probe touched at rest, if it did.
    pub(crate) fn touched(&self) -> Option<Position<Mm>> {
        let is_contact = self.end == Some(DescentEnd::Contact) && !self.rest.is_empty();
        is_contact.then_some(self.here)
    }

    /// The mean impedance of the clear probe, at the beginning of the descent.
    pub(crate) fn reference(&self) -> Option<Impedance> {
        self.watch.reference()
    }

    /// The impedance has been read at rest.
    pub(crate) fn read_at_rest(&mut self, readings: &[Reading]) -> DescentStep {
        self.rest = readings.iter().map(|reading| (self.here, *reading)).collect();
        let last = readings.last().map(|last| last.measured);
        let (Some(PointResult::Value(last)), Some(reference)) = (last, self.watch.reference())
        else {
            return DescentStep::GiveUp("the analyzer flags its readings at rest".to_owned());
        };
        let is_clear = relative_change(reference, last) <= REST_PART * self.threshold;
        match (is_clear, self.end, self.alarms_left) {
            (true, Some(DescentEnd::Target), _) => {
                DescentStep::Fault(Fault::NoContact { at: self.here, expected: self.expected })
            }
            (true, _, 0) => DescentStep::GiveUp(format!(
                "{} contacts of the descent were gone at rest",
                FALSE_ALARMS_MAX + 1
            )),
            (true, ..) => {
                self.alarms_left -= 1;
                self.watch.forget();
                // It goes on where a contact was suspected, with no room above the surface.
                self.first_silence = self.silence + self.reading;
                self.go_down()
            }
            (false, ..) => self.fit(),
        }
    }

    fn fit(&self) -> DescentStep {
        let way = way::even(&self.way, (self.from, self.here), self.speed_mm_per_s);
        let way = match way {
            Ok(way) => way,
            Err(uneven) => return DescentStep::GiveUp(uneven.to_string()),
        };
        let readings: Vec<Reading> =
            self.readings.iter().chain(self.rest.iter().map(|(_, one)| one)).copied().collect();
        match Onset::fit(&self.no_load, &readings, &way, self.latency, self.sigma_max_mm) {
            Ok(onset) => {
                let position = Position::new(onset.surface_mm);
                DescentStep::Found(Surface { position, sigma_mm: onset.sigma_mm }, onset)
            }
            Err(refusal) => DescentStep::GiveUp(refusal.to_string()),
        }
    }
}
