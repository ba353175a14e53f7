//! The page of the laboratory, as HTML of the server. It has no script, and asks no other host for anything.

mod compare;

use maud::{Markup, html};
use rig_report::document;

use crate::{
    catalogue::{FoundRun, Rig, Wanted},
    compare::Reference,
};

/// A rig that has not called for longer is shown as gone, s: three greetings of its shipper.
const GONE_S: i64 = 90;
/// Ends of a run that can be asked for.
const STATUSES: [&str; 6] =
    ["running", "completed", "completed_with_refusals", "aborted", "faulted", "interrupted"];
/// The words of a judged model.
const VERDICTS: [&str; 3] = ["holds", "strained", "rejected"];
/// What changes by itself is loaded again after this time, s.
const RELOAD_S: u32 = 10;
const STYLE: &str = include_str!("page.css");

/// The rigs and the latest runs. It is loaded again by itself.
pub(crate) fn rigs(rigs: &[Rig], runs: &[FoundRun]) -> String {
    page(
        "Rigs",
        Some(RELOAD_S),
        &html! {
            h1 { "Rigs" (links([("/runs", "runs"), ("/compare", "compare")])) }
            (rig_table(rigs))
            h2 { "Latest runs " a href="/runs" { "search" } }
            (run_table(runs))
        },
    )
}

/// The wanted runs, and what can be wanted.
pub(crate) fn runs(rigs: &[Rig], runs: &[FoundRun], wanted: &Wanted) -> String {
    page(
        "Runs",
        None,
        &html! {
            h1 { "Runs" (links([("/", "rigs"), ("/compare", "compare")])) }
            (search(rigs, wanted))
            (run_table(runs))
        },
    )
}

/// The reference samples on the benches that have measured them.
pub(crate) fn references(references: &[Reference]) -> String {
    page("Compare", None, &compare::body(references))
}

/// What is shown when the hub cannot be read.
pub(crate) fn trouble(error: &str) -> String {
    page(
        "The hub cannot be read",
        Some(RELOAD_S),
        &html! {
            h1 { "The hub cannot be read" }
            p { (error) }
            p { "The rigs measure on. Look at " code { "rigd-hub doctor" } "." }
        },
    )
}

fn page(title: &str, reload_s: Option<u32>, body: &Markup) -> String {
    document(&html! { (title) }, &[STYLE, rig_chart::STYLE], reload_s, body).into_string()
}

/// Links to the pages of the laboratory, without the present one.
fn links(to: [(&str, &str); 2]) -> Markup {
    html! { @for (address, text) in to { " " a href=(address) { (text) } } }
}

fn rig_table(rigs: &[Rig]) -> Markup {
    html! {
        table {
            thead { tr { th { "bench" } th { "state" } th { "run" } th { "a person is asked to" } th { "last seen" } } }
            tbody {
                @for rig in rigs {
                    tr {
                        td { (link(rig.page.as_deref(), &html! { b { (rig.bench) } })) @if rig.alarms > 0 { " " span.alarm { (rig.alarms) " alarms" } } }
                        td { (state(rig)) }
                        td {
                            @if let Some(run) = &rig.run {
                                (run)
                                @if let (Some(done), Some(all)) = (rig.touches_done, rig.touches) {
                                    " " span.quiet { (done) " of " (all) " touches" }
                                }
                            }
                        }
                        td { @if let Some(waits) = &rig.waits { span.waits { (waits) } } }
                        td { (seen(rig)) }
                    }
                }
                @if rigs.is_empty() { tr { td colspan="5" { "No bench yet: " code { "rigd-hub bench add LAB/NAME" } } } }
            }
        }
    }
}

fn state(rig: &Rig) -> Markup {
    html! {
        @match rig.state.as_deref() {
            None => span.quiet { "unknown" },
            Some(state) if state == "latched" || state == "faulted" => span.alarm { (state) },
            Some(state) => (state),
        }
        @if let Some(reason) = &rig.reason { br; span.quiet { (reason) } }
    }
}

fn seen(rig: &Rig) -> Markup {
    let is_gone = rig.seen_s_ago.is_none_or(|ago| ago > GONE_S);
    let text = match rig.seen_s_ago {
        None => "never".to_owned(),
        Some(ago) if ago < 120 => format!("{ago} s ago"),
        Some(ago) if ago < 7200 => format!("{} min ago", ago / 60),
        Some(ago) if ago < 172_800 => format!("{} h ago", ago / 3600),
        Some(ago) => format!("{} days ago", ago / 86_400),
    };
    let at = rig.last_seen.as_deref().unwrap_or_default();
    html! { span class=(if is_gone { "gone" } else { "there" }) title=(at) { (text) } }
}

fn search(rigs: &[Rig], wanted: &Wanted) -> Markup {
    let field = |name: &str, label: &str, value: &str| {
        html! { label { (label) input name=(name) value=(value); } }
    };
    html! {
        form method="get" action="/runs" {
            label { "bench"
                select name="bench" {
                    option value="" { "all" }
                    @for rig in rigs {
                        option value=(rig.bench) selected[rig.bench == wanted.bench] { (rig.bench) }
                    }
                }
            }
            (field("protocol", "protocol", &wanted.protocol))
            (field("sample", "sample", &wanted.sample))
            (field("operator", "operator", &wanted.operator))
            label { "end"
                select name="status" {
                    option value="" { "any" }
                    @for status in STATUSES {
                        option value=(status) selected[status == wanted.status] { (status.replace('_', " ")) }
                    }
                }
            }
            label { "model"
                select name="verdict" {
                    option value="" { "any" }
                    @for verdict in VERDICTS {
                        option value=(verdict) selected[verdict == wanted.verdict] { (verdict) }
                    }
                }
            }
            (field("from", "from", &wanted.from))
            (field("until", "until", &wanted.until))
            button { "search" }
            a href="/runs" { "all" }
        }
    }
}

fn run_table(runs: &[FoundRun]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "begun (UTC)" } th { "bench" } th { "protocol" } th { "samples" } th { "operators" } th { "end" }
                th.number { "measured" } th.number { "refused" } th { "model" } th { "seal" }
            } }
            tbody {
                @for run in runs {
                    tr {
                        td title=(run.run_id) {
                            (link(run.report.as_deref(), &html! { (minute(&run.started_at)) }))
                        }
                        td { (run.bench) }
                        td { (run.protocol) @if run.is_simulated == Some(true) { " " span.quiet { "simulated" } } }
                        td { (run.samples.join(", ")) }
                        td { (run.operators.join(", ")) }
                        td { (run.status.replace('_', " ")) }
                        td.number { (run.measured) }
                        td.number { (run.refused) }
                        td {
                            @match run.model_verdict.as_deref() {
                                Some("holds") => "holds",
                                Some(verdict) => span.alarm { (verdict) },
                                None => span.quiet { "–" },
                            }
                        }
                        td {
                            @if run.has_clash { span.alarm { "clash" } }
                            @else if let Some(object) = &run.object { span title=(object) { "checked, archived" } }
                            @else if run.is_sealed { "checked" }
                            @else { span.quiet { "open" } }
                        }
                    }
                }
                @if runs.is_empty() { tr { td colspan="10" { "No run is as wanted." } } }
            }
        }
    }
}

/// A text that leads to an address, if there is one.
fn link(address: Option<&str>, text: &Markup) -> Markup {
    html! {
        @if let Some(address) = address { a href=(address) { (text) } } @else { (text) }
    }
}

/// A time to the minute.
fn minute(at: &str) -> String {
    at.get(..16).unwrap_or(at).replace('T', " ")
}
