//! The keys of the file of an analyzer.

use rig_model::{AnalyzerMake, Terminator};

use super::{
    answer_keys::{answer, integration},
    compensation_keys::compensation,
    dialect::{
        CommandSet, Dialect, Handshake, HighPower, PointCommands, Poll, Resolution, TransportRules,
    },
    fault::InstrumentFault,
    refuse_what_is_code,
    template::{Quantity, Template},
};
use crate::settings::{Entry, Section, Setting, Table};

/// Reads the file of an analyzer from its root.
pub(super) fn dialect(table: &mut Table<'_>) -> Dialect {
    refuse_what_is_code(table);
    let name = table.text("name").max_chars(40).required().value;
    let models = table.text("models").required().value;
    let prefixes = table.text("model_prefixes").list().required().value;
    let makes = AnalyzerMake::ALL.map(|make| (make.name(), make));
    let simulated_as = table.choice("simulated_as", makes).optional();
    let trace = table.choice("trace", [("e4990a", ())]).optional();
    let frequency_hz = table.number("frequency_hz").above(0.0).interval().required().value;
    let level_v = table.number("level_v").above(0.0).interval().required().value;
    let delay_max_s = table.number("delay_max_s").range(0.0..=10_000.0).required().value;
    let resolution = table.section("frequency_steps", steps).required().value;
    let transport = table.section("transport", transport).required().value;
    let high_power = table.section("high_power", high_power).optional();
    let commands = commands(table, trace.is_some());
    let compensation = table.section("compensation", compensation).optional();
    Dialect {
        name,
        models,
        model_prefixes: prefixes.into_iter().map(|prefix| prefix.value).collect(),
        simulated_as: simulated_as.map(|make| make.value),
        frequency_hz,
        level_v,
        resolution,
        high_power: high_power.map(|option| option.value),
        delay_max_s,
        transport,
        commands,
        compensation: compensation.map(|compensation| compensation.value),
    }
}

fn steps(table: &mut Table<'_>) -> Resolution {
    let step_hz = table.number("step_hz").above(0.0).optional();
    let digits = table.count("digits").range(2..=12).optional();
    let finest_hz = table.number("finest_hz").above(0.0).optional();
    let nearest_rel = table.number("nearest_rel").range(1e-6..=0.1).optional();
    if let (Some(finest), None) = (&finest_hz, &digits) {
        table.refuse(finest, &InstrumentFault::FinestAlone);
    }
    let finest_hz = finest_hz.map_or(0.0, |finest| finest.value);
    match (step_hz, digits, nearest_rel) {
        (Some(step), None, None) => Resolution::Step(step.value),
        (None, Some(digits), None) => {
            Resolution::Digits(i32::try_from(digits.value).unwrap_or(i32::MAX), finest_hz)
        }
        (None, None, Some(share)) => Resolution::Nearest(share.value),
        _ => {
            if table.is_there() {
                table.refuse(table.location(), &InstrumentFault::Steps);
            }
            Resolution::Nearest(0.01)
        }
    }
}

fn transport(table: &mut Table<'_>) -> TransportRules {
    let terminators = Terminator::ALL.map(|terminator| (terminator.name(), terminator));
    let terminator = table.choice("terminator", terminators).required().value;
    let greeting = optional_message(table, "greeting", &[], 0);
    let has_error_queue = table.flag("error_queue").required().value;
    let handshakes = [("none", Handshake::None), ("echo", Handshake::EchoEachCharacter)];
    let handshake = table.choice("handshake", handshakes).or(Handshake::None).value;
    TransportRules { terminator, greeting, has_error_queue, handshake }
}

fn high_power(table: &mut Table<'_>) -> HighPower {
    HighPower {
        option: table.text("option").required().value,
        max_v: table.number("max_level_v").above(0.0).required().value,
        switch: optional_message(table, "switch", &[], 0),
    }
}

/// The messages of the file, or the commands of a trace, which the file must not have.
fn commands(table: &mut Table<'_>, is_trace: bool) -> CommandSet {
    let sections = [
        needed(table, "setup", is_trace, |table| table.section("setup", setup)).map(Read::Setup),
        needed(table, "measure", is_trace, |table| table.section("measure", measure))
            .map(Read::Measure),
        needed(table, "integration", is_trace, |table| table.section("integration", integration))
            .map(Read::Integration),
        needed(table, "answer", is_trace, |table| table.section("answer", answer))
            .map(Read::Answer),
    ];
    let [
        Some(Read::Setup(setup)),
        Some(Read::Measure(measure)),
        Some(Read::Integration(integration)),
        Some(Read::Answer(answer)),
    ] = sections
    else {
        return CommandSet::TraceE4990a;
    };
    CommandSet::Points(Box::new(PointCommands {
        setup: setup.messages,
        level: setup.level,
        set_frequency: measure.set_frequency,
        frequency: measure.frequency,
        set_averages: measure.set_averages,
        set_delay: measure.set_delay,
        trigger: measure.trigger,
        poll: measure.poll,
        read: measure.read,
        integration,
        answer,
    }))
}

struct Setup {
    messages: Vec<Template>,
    level: Template,
}

fn setup(table: &mut Table<'_>) -> Setup {
    let texts = table.text("messages").list().at_most(100).required();
    let read = |text: &Setting<String>| message(table, text, &[Quantity::Level], 0);
    let messages: Vec<_> = texts.value.iter().map(read).collect();
    let is_read = texts.sound().is_some() && !messages.iter().any(|m| m.units.is_empty());
    if is_read && !messages.iter().any(|message| message.holds(Quantity::Level)) {
        table.refuse(&texts, &InstrumentFault::NoLevel);
    }
    Setup { messages, level: required_message(table, "level", &[], 1) }
}

struct Measure {
    set_frequency: Template,
    frequency: Template,
    set_averages: Template,
    set_delay: Template,
    trigger: Template,
    poll: Option<Poll>,
    read: Template,
}

fn measure(table: &mut Table<'_>) -> Measure {
    Measure {
        set_frequency: setting(table, "set_frequency", Quantity::Frequency),
        frequency: required_message(table, "frequency", &[], 1),
        set_averages: setting(table, "set_averages", Quantity::Averages),
        set_delay: setting(table, "set_delay", Quantity::Delay),
        trigger: required_message(table, "trigger", &[], 0),
        poll: table.section("poll", poll).optional().map(|poll| poll.value),
        read: required_message(table, "read", &[], 1),
    }
}

fn poll(table: &mut Table<'_>) -> Poll {
    Poll {
        ask: required_message(table, "ask", &[], 1),
        mask: table.count("mask").at_least(1).required().value,
        timeout_s: table.number("timeout_s").range(0.1..=600.0).required().value,
    }
}

/// A message that sets this quantity.
pub(super) fn setting(table: &mut Table<'_>, key: &'static str, quantity: Quantity) -> Template {
    let text = table.text(key).required();
    let template = message(table, &text, &[quantity], 0);
    if !template.units.is_empty() && !template.holds(quantity) {
        let fault = InstrumentFault::WithoutQuantity { key, word: quantity.word() };
        table.refuse(&text, &fault);
    }
    template
}

pub(super) fn required_message(
    table: &mut Table<'_>,
    key: &'static str,
    allowed: &[Quantity],
    questions: usize,
) -> Template {
    let text = table.text(key).required();
    message(table, &text, allowed, questions)
}

fn optional_message(
    table: &mut Table<'_>,
    key: &'static str,
    allowed: &[Quantity],
    questions: usize,
) -> Option<Template> {
    let text = table.text(key).optional()?;
    Some(message(table, &text, allowed, questions))
}

/// The message of a setting; an empty one after a fault.
fn message(
    table: &Table<'_>,
    text: &Setting<String>,
    allowed: &[Quantity],
    questions: usize,
) -> Template {
    let Some(written) = text.sound() else { return Template::default() };
    let key = text.key;
    match Template::parse(written, allowed) {
        Ok(template) if template.n_questions() == questions => template,
        Ok(template) => {
            let (found, expected) = (template.n_questions(), questions);
            table.refuse(text, &InstrumentFault::Questions { key, found, expected });
            Template::default()
        }
        Err(fault) => {
            let words = allowed.iter().map(|quantity| quantity.word()).collect();
            table.refuse(text, &InstrumentFault::Message { key, fault, words });
            Template::default()
        }
    }
}

/// A section of the messages of an analyzer that measures points.
enum Read {
    Setup(Setup),
    Measure(Measure),
    Integration(super::dialect::IntegrationRule),
    Answer(super::dialect::AnswerForm),
}

/// Reads a section that an analyzer of points needs, and one of traces must not have.
fn needed<'d, T, F: Fn(&mut Table<'_>) -> T>(
    table: &mut Table<'d>,
    section: &'static str,
    is_trace: bool,
    entry: impl for<'t> Fn(&'t mut Table<'d>) -> Entry<'t, 'd, Section<F>>,
) -> Option<T> {
    let found = entry(table).optional();
    match (&found, is_trace) {
        (None, false) if table.is_there() => {
            table.refuse(table.location(), &InstrumentFault::NoSection { section });
        }
        (Some(given), true) => {
            table.refuse(given, &InstrumentFault::SectionOfPoints { section });
        }
        _ => {}
    }
    found.map(|found| found.value)
}
