//! `rigd status`, `pause`, `resume`, `abort`, `stop`, `answer` and `acknowledge`: to the daemon that serves
//! a data directory.

use std::time::Duration;

use clap::{Args, ValueEnum};
use serde_json::Value;
use tokio::time::timeout;

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs},
    client::{Client, DaemonError, in_commands},
    live::{Progress, range},
    table::{concluded, print, print_json, wrapped},
};
use crate::rig_view::{DeviceView, RefusedView, RigView, RunProgress, SilenceView};

#[derive(Debug, Args)]
pub(super) struct StatusArgs {
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A command to a daemon.
#[derive(Debug, Args)]
pub(super) struct DaemonArgs {
    #[command(flatten)]
    pub(super) data: DataArgs,
    #[command(flatten)]
    pub(super) operator: OperatorArgs,
}

#[derive(Debug, Args)]
pub(super) struct AnswerArgs {
    /// What to answer
    #[arg(value_enum, default_value_t = Answer::Done)]
    answer: Answer,
    #[command(flatten)]
    daemon: DaemonArgs,
}

#[derive(Debug, Args)]
pub(super) struct AcknowledgeArgs {
    /// Say that a person has seen that nothing is below the probe, down to the end of its travel; a
    /// linear stage that has lost its position is then homed, even downwards
    #[arg(long)]
    nothing_below_probe: bool,
    #[command(flatten)]
    daemon: DaemonArgs,
}

/// An answer to the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Answer {
    /// To a prompt: what it asks for has been done
    Done,
    /// After a refused touch: widen the window of the sweep and repeat
    Widen,
    /// After a refused touch: repeat
    Repeat,
    /// After a refused touch: keep the refusal
    Skip,
    /// After a refused touch: end the run
    Abort,
}

/// A command that needs no words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Pause,
    Resume,
    Abort,
    Stop,
    Acknowledge,
    /// Acknowledges and homes, after a person has seen that nothing is below the probe.
    Home,
}

/// The statement of a person, without which the daemon does not home.
const NOTHING_BELOW: &str = "{\"nothing_below_probe\": true}";

/// The rig may move for this long after a stop: a slow stage needs 20 s for its whole travel.
const SETTLE_TIME: Duration = Duration::from_secs(60);

pub(super) fn status(args: &StatusArgs) -> Result<(), Failure> {
    let operator = crate::operator::Operator::login();
    let view: Value =
        over_http(async { Client::find(&args.data.dir(), &operator)?.get("/api/v1/rig").await })?;
    if args.output.json {
        return print_json(&view);
    }
    let view: RigView = serde_json::from_value(view).map_err(|error| Failure::System {
        what: "the answer of the daemon",
        source: error.into(),
    })?;
    print(&view.text())
}

pub(super) fn order(args: &DaemonArgs, order: Order) -> Result<(), Failure> {
    let view = over_http(async {
        let client = args.client()?;
        let of_run = async |verb: &str| {
            let rig: RigView = client.get("/api/v1/rig").await?;
            let run = rig.run.ok_or(DaemonError::NoRun)?.id;
            client.post(&format!("/api/v1/runs/{run}/{verb}")).await
        };
        match order {
            Order::Pause => of_run("pause").await?,
            Order::Resume => of_run("resume").await?,
            Order::Abort => of_run("abort").await?,
            Order::Stop => client.post("/api/v1/stop").await?,
            Order::Acknowledge => client.post("/api/v1/acknowledge").await?,
            Order::Home => client.post_json("/api/v1/home", NOTHING_BELOW).await?,
        }
        match order {
            Order::Pause | Order::Resume => client.get("/api/v1/rig").await,
            Order::Abort | Order::Stop | Order::Acknowledge | Order::Home => settled(&client).await,
        }
    })?;
    let printed = print(&view.text());
    let is_safe = view.probe == "clear" && (order == Order::Stop || view.fault.is_none());
    if is_safe || matches!(order, Order::Pause | Order::Resume) {
        return printed;
    }
    // Its cause has been printed.
    concluded(printed, Err(Failure::DaemonLatched { probe: view.probe }))
}

pub(super) fn acknowledge(args: &AcknowledgeArgs) -> Result<(), Failure> {
    let is_seen = args.nothing_below_probe;
    order(&args.daemon, if is_seen { Order::Home } else { Order::Acknowledge })
}

pub(super) fn answer(args: &AnswerArgs) -> Result<(), Failure> {
    let view = over_http(async {
        let client = args.daemon.client()?;
        let rig: RigView = client.get("/api/v1/rig").await?;
        let run = rig.run.as_ref().ok_or(DaemonError::NoRun)?;
        let query = rig.query(args.answer)?;
        client.post(&format!("/api/v1/runs/{}/answer?{query}", run.id)).await?;
        client.get::<RigView>("/api/v1/rig").await
    })?;
    print(&view.text())
}

impl DaemonArgs {
    pub(super) fn client(&self) -> Result<Client, DaemonError> {
        Client::find(&self.data.dir(), &self.operator.name())
    }
}

/// Waits until the rig rests, and gives its last state.
async fn settled(client: &Client) -> Result<RigView, DaemonError> {
    let mut events = client.events().await?;
    let rest = async {
        while let Some(event) = events.next().await? {
            let Ok(view) = serde_json::from_str::<RigView>(&event.data) else { continue };
            if matches!(view.state.as_str(), "idle" | "latched") {
                return Ok(view);
            }
        }
        client.get("/api/v1/rig").await
    };
    match timeout(SETTLE_TIME, rest).await {
        Ok(view) => view,
        Err(_) => client.get("/api/v1/rig").await,
    }
}

/// Runs requests to a daemon.
pub(super) fn over_http<T>(
    work: impl Future<Output = Result<T, DaemonError>>,
) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|source| Failure::System { what: "runtime", source })?;
    Ok(runtime.block_on(work)?)
}

impl RigView {
    /// The parameters of an answer to what the daemon asks.
    fn query(&self, answer: Answer) -> Result<String, DaemonError> {
        let word = match answer {
            Answer::Done => None,
            Answer::Widen => Some("widen"),
            Answer::Repeat => Some("repeat"),
            Answer::Skip => Some("skip"),
            Answer::Abort => Some("abort"),
        };
        match (&self.asked, &self.refused, word) {
            (Some(asked), _, None) => Ok(format!("step={}", encoded(&asked.step))),
            (_, Some(refused), Some(word)) => {
                Ok(format!("step={}&refused={word}", encoded(&refused.step)))
            }
            (_, Some(_), None) => Err(DaemonError::WrongAnswer(
                "a touch was refused: answer with `widen`, `repeat`, `skip` or `abort`",
            )),
            (Some(_), _, Some(_)) => Err(DaemonError::WrongAnswer(
                "no touch was refused: `rigd answer` without a word answers the open prompt",
            )),
            (None, None, _) => Err(DaemonError::NothingAsked),
        }
    }

    /// What the daemon asks for, and the command that answers.
    pub(super) fn question(&self) -> Option<String> {
        let refused = self.refused.as_ref().map(|RefusedView { step, reason, .. }| {
            format!("touch {step} was refused: {reason}; `rigd answer widen`, `repeat`, `skip` or `abort`")
        });
        let prompt = self.prompt.as_ref();
        refused.or_else(|| prompt.map(|prompt| format!("{prompt} Then `rigd answer`.")))
    }

    /// The fault, and what to do.
    pub(super) fn fault(&self) -> Option<[String; 2]> {
        self.fault.as_ref().map(|fault| [fault.cause.clone(), in_commands(&fault.hint)])
    }

    /// For a person.
    fn text(&self) -> String {
        let kind = if self.is_simulated { "SIMULATED" } else { "REAL" };
        let mut rows =
            vec![("rig", format!("{}, {kind}", self.name)), ("state", self.state.clone())];
        let mut row = |name: &'static str, text: Option<String>| {
            rows.extend(text.map(|text| (name, text)));
        };
        if let Some(SilenceView { message, hint, .. }) = &self.silence {
            row("no answer", Some(format!("{message}; what follows is old")));
            row("to do", Some(hint.clone()));
        }
        row("asks", self.question());
        if let Some([cause, advice]) = self.fault() {
            row("fault", Some(cause));
            row("to do", Some(advice));
        }
        row("journal", self.journal_error.clone());
        row("probe", Some(self.probe.clone()));
        row("linear stage", self.linear_mm.map(|mm| format!("{mm:.3} mm")));
        row("rotary stage", self.rotary_deg.map(|deg| format!("{deg:.3} °")));
        if let Some(run) = &self.run {
            let refused = match run.touches_refused {
                0 => String::new(),
                refused => format!(", {refused} refused"),
            };
            let pausing = if run.ahead.is_pausing { "; pausing after this step" } else { "" };
            let RunProgress { protocol, step, steps, doing, .. } = run;
            let (measured, planned) = (run.touches_measured, run.touches_planned);
            let [least_s, most_s] = run.ahead.remaining_s;
            row("run", Some(format!("{protocol}, step {step} of {steps}: {doing}{pausing}")));
            row("touches", Some(format!("{measured} of {planned} measured{refused}")));
            row("to go", Some(range(least_s, most_s)));
            let next = run.ahead.next_prompt.as_ref();
            row(
                "next prompt",
                next.map(|next| {
                    format!("in about {}: {}", range(next.in_s, next.in_s), next.prompt)
                }),
            );
        }
        rows.extend(self.devices.iter().map(|device| (HEALTH_OF, health(device))));
        wrapped(&rows)
    }

    /// The progress of the run under way.
    pub(super) fn progress(&self) -> Option<Progress> {
        let run = self.run.as_ref()?;
        Some(Progress {
            step: run.step,
            steps: run.steps,
            doing: run.doing.clone(),
            remaining_s: run.ahead.remaining_s,
            estimate_hz: None,
            is_pausing: run.ahead.is_pausing,
        })
    }
}

/// Head of the rows with the counts of the devices.
const HEALTH_OF: &str = "device";

/// A device and its counts, those of faults only if there are any.
fn health(DeviceView { role, health, .. }: &DeviceView) -> String {
    let counts = [
        (health.retries, "repeated"),
        (health.late, "late"),
        (health.corrupt, "corrupt"),
        (health.refusals, "refused"),
    ];
    let seen = counts.iter().filter(|(count, _)| *count > 0);
    let mut parts: Vec<_> = seen.map(|(count, what)| format!("{count} {what}")).collect();
    if parts.is_empty() {
        parts.push("all answered".to_owned());
    }
    let last = health.last_round_trip_ms.map(|ms| format!("; last answer after {ms:.1} ms"));
    let last = last.unwrap_or_default();
    format!("{role}: {} requests, {}{last}", health.requests, parts.join(", "))
}

/// A value of a query: all bytes but letters, digits and `-._~/` as their numbers.
fn encoded(text: &str) -> String {
    let byte = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
            char::from(byte).to_string()
        }
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_safe_in_a_query() {
        assert_eq!(encoded("main/3/left/30/1"), "main/3/left/30/1");
        assert_eq!(encoded("a b&c=\u{e9}+#"), "a%20b%26c%3D%C3%A9%2B%23");
    }
}
