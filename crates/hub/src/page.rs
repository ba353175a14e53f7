//! The page of the laboratory, as HTML of the server. It has no script, and asks no other host for anything.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::catalogue::{FoundRun, Rig, Wanted};

/// A rig that has not called for longer is shown as gone, s: three greetings of its shipper.
const GONE_S: i64 = 90;
/// Ends of a run that can be asked for.
const STATUSES: [&str; 6] =
    ["running", "completed", "completed_with_refusals", "aborted", "faulted", "interrupted"];
const STYLE: &str = include_str!("page.css");

/// The rigs and the latest runs. It is loaded again by itself.
pub(crate) fn rigs(rigs: &[Rig], runs: &[FoundRun]) -> String {
    document(
        "Rigs",
        true,
        &html! {
            h1 { "Rigs" }
            (rig_table(rigs))
            h2 { "Latest runs " a href="/runs" { "search" } }
            (run_table(runs))
        },
    )
}

/// The wanted runs, and what can be wanted.
pub(crate) fn runs(rigs: &[Rig], runs: &[FoundRun], wanted: &Wanted) -> String {
    document(
        "Runs",
        false,
        &html! {
            h1 { "Runs " a href="/" { "rigs" } }
            (search(rigs, wanted))
            (run_table(runs))
        },
    )
}

/// What is shown when the hub cannot be read.
pub(crate) fn trouble(error: &str) -> String {
    document(
        "The hub cannot be read",
        true,
        &html! {
            h1 { "The hub cannot be read" }
            p { (error) }
            p { "The rigs measure on. Look at " code { "rigd-hub doctor" } "." }
        },
    )
}

fn document(title: &str, is_reloaded: bool, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                @if is_reloaded { meta http-equiv="refresh" content="10"; }
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

fn rig_table(rigs: &[Rig]) -> Markup {
    html! {
        table {
            thead { tr { th { "bench" } th { "state" } th { "run" } th { "a person is asked to" } th { "last seen" } } }
            tbody {
                @for rig in rigs {
                    tr {
                        td { b { (rig.bench) } @if rig.alarms > 0 { " " span.alarm { (rig.alarms) " alarms" } } }
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
                th.number { "measured" } th.number { "refused" } th { "seal" }
            } }
            tbody {
                @for run in runs {
                    tr {
                        td title=(run.run_id) { (minute(&run.started_at)) }
                        td { (run.bench) }
                        td { (run.protocol) @if run.is_simulated == Some(true) { " " span.quiet { "simulated" } } }
                        td { (run.samples.join(", ")) }
                        td { (run.operators.join(", ")) }
                        td { (run.status.replace('_', " ")) }
                        td.number { (run.measured) }
                        td.number { (run.refused) }
                        td {
                            @if run.has_clash { span.alarm { "clash" } }
                            @else if run.is_sealed { "checked" }
                            @else { span.quiet { "open" } }
                        }
                    }
                }
                @if runs.is_empty() { tr { td colspan="9" { "No run is as wanted." } } }
            }
        }
    }
}

/// A time to the minute.
fn minute(at: &str) -> String {
    at.get(..16).unwrap_or(at).replace('T', " ")
}
