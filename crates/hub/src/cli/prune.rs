//! `rigd-hub prune`: removes records that are in verified objects.

use clap::Args;
use rig_ship::{Address, ObjectStore};

use super::{DatabaseArgs, Failure, print_json, say};
use crate::{Pruned, prune};

#[derive(Debug, Args)]
pub(super) struct PruneArgs {
    /// Where `rigd ship` has put the runs: `folder:DIR` or `s3://BUCKET/PREFIX`
    objects: Address,
    /// Days for which records are kept after the hub has taken the last one of their run
    #[arg(long, value_name = "DAYS", default_value_t = 90, value_parser = clap::value_parser!(i32).range(1..=36500))]
    keep_days: i32,
    #[command(flatten)]
    database: DatabaseArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) async fn prune_records(args: PruneArgs) -> Result<(), Failure> {
    let (client, _task) = args.database.connect().await?;
    let pruned = prune(&client, ObjectStore::at(args.objects)?, args.keep_days).await?;
    if args.json { print_json(&pruned) } else { say(&text(&pruned, args.keep_days)) }
}

fn text(pruned: &Pruned, keep_days: i32) -> String {
    let mut lines = vec![format!(
        "{} records of {} runs removed, of which the hub has taken the last one more than {keep_days} days ago",
        pruned.records, pruned.runs
    )];
    lines.extend(pruned.stayed.iter().map(|(reason, runs)| format!("{runs} runs stay: {reason}")));
    lines.join("\n")
}
