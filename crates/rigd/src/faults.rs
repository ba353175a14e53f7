//! The faults of a bench: the reaction of rigd to each, what a person sees and does, and the tests that
//! show it. `docs/faults.md` is [`page`], which `rigd faults` prints.
//!
//! A message is made by the code that reports the fault, with example values, and its advice by the
//! code that gives it.

mod device;
mod examples;
mod host;
mod wire;

use std::fmt::{self, Write};

use rig_engine::Fault;
use rig_model::Clearance;

use crate::hint;

/// Where a fault comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultClass {
    /// The line between computer and device.
    Wire,
    /// A device, the sensor or the sample.
    Device,
    /// The computer, its disk and its clock.
    Host,
    /// People and networks.
    Person,
}

/// A fault of the list.
#[derive(Debug, Clone, Copy)]
pub struct ListedFault {
    /// Its number, from 1.
    pub number: u8,
    /// Where it comes from.
    pub class: FaultClass,
    /// What happens.
    pub what: &'static str,
    /// What rigd does.
    pub reaction: &'static str,
    /// What the person sees, and what it says to do; `None` without a reaction.
    pub seen: Option<fn() -> Seen>,
    /// The tests that show it: file and name.
    pub tests: &'static [(&'static str, &'static str)],
}

/// A message with its advice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seen {
    /// The message.
    pub message: String,
    /// What it says to do; `None` if nothing needs to be done.
    pub advice: Option<String>,
}

impl Seen {
    /// A fault that latched the rig, with a clear probe.
    fn latched(fault: &Fault) -> Self {
        let advice = hint::after(fault, Clearance::Clear).text.to_owned();
        Self { message: fault.to_string(), advice: Some(advice) }
    }

    /// Something that is refused, with its advice.
    fn refused(error: &(dyn std::error::Error + 'static), advice: Option<&str>) -> Self {
        Self { message: rig_model::with_causes(error), advice: advice.map(ToOwned::to_owned) }
    }

    /// A line in the log of an event after which nothing needs to be done.
    fn noted(message: &str) -> Self {
        Self { message: message.to_owned(), advice: None }
    }
}

impl fmt::Display for FaultClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Wire => "wire",
            Self::Device => "device",
            Self::Host => "host",
            Self::Person => "person",
        })
    }
}

/// Every fault, in order.
pub fn all() -> impl Iterator<Item = &'static ListedFault> {
    wire::FAULTS.iter().chain(&device::FAULTS).chain(&host::FAULTS)
}

/// The page about all faults, in Markdown.
pub fn page() -> String {
    let mut page = HEAD.to_owned();
    for fault in all() {
        let ListedFault { number, class, what, reaction, .. } = fault;
        let seen = fault.seen.map(|seen| seen());
        let message = seen.as_ref().map_or("-".to_owned(), |seen| code(&seen.message));
        let advice = seen.and_then(|seen| seen.advice).unwrap_or_else(|| "-".to_owned());
        let tests: Vec<String> =
            fault.tests.iter().map(|(file, name)| format!("`{file}` {name}")).collect();
        let tests = if tests.is_empty() { "-".to_owned() } else { tests.join("; ") };
        // Writing to a string cannot fail.
        _ = writeln!(
            page,
            "| {number} | {class} | {what} | {reaction} | {message} | {} | {tests} |",
            cell(&advice)
        );
    }
    page
}

const HEAD: &str = "\
# Faults

`rigd faults` prints this page from the code. Each message is made by the code that reports the fault, with
example values; the advice is for a probe that is clear. While the probe may be in contact, the advice is
to touch neither the sample nor the stages.

**Safe** means: both axes stop, the linear drive is found again and resets an alarm once, the probe is
retracted until a read-back shows it clear, and the rig latches with its first cause until a person
acknowledges it ([decision 34](decisions/0034-the-way-out-of-contact.md)). A run that ended so is resumed
with `rigd run --resume`. A stop does the same in every state but one: during the way out both axes have got their
stop, so that another one sends nothing, and the retract goes on
([decision 65](decisions/0065-a-stop-during-a-retract.md)). A rotary stage that turned and has not answered its stop
gets it again ([decision 194](decisions/0194-a-stop-goes-first-and-is-repeated.md)).

| # | class | fault | rigd | the person sees | the person does | tests |
|---|---|---|---|---|---|---|
";

/// A message as code in a table, on one line.
fn code(message: &str) -> String {
    format!("`{}`", cell(&message.replace('`', "'")))
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}
