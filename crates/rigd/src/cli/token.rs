//! `rigd token`, `rigd open` and `rigd lease`: who may come in, and who operates.

use std::process::{Command, Stdio};

use clap::{Args, Subcommand};
use jiff::Timestamp;
use rig_system::files::protection;
use serde::{Deserialize, Serialize};

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs},
    client::Client,
    daemon::over_http,
    table::{columns, note, print, print_json},
};
use crate::{
    operator::Operator,
    rig_view::RigView,
    tokens::{self, Role},
};

#[derive(Debug, Args)]
pub(super) struct TokenArgs {
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Debug, Subcommand)]
enum TokenCommand {
    /// Make a token and print it, once
    New {
        /// Name of the person or program, as the journal will have it
        name: Operator,
        /// What the token allows
        #[arg(long, value_enum, default_value_t = Role::Operate)]
        role: Role,
        #[command(flatten)]
        data: DataArgs,
    },
    /// List the names, roles and last uses of the tokens
    List {
        #[command(flatten)]
        data: DataArgs,
        #[command(flatten)]
        output: OutputArgs,
    },
    /// Take a token out; a running daemon refuses it from then on
    Revoke {
        /// Name of the person or program
        name: Operator,
        #[command(flatten)]
        data: DataArgs,
    },
}

/// A token, for a program.
#[derive(Debug, Serialize)]
struct TokenView {
    name: String,
    role: Role,
    made_unix_s: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    used_unix_s: Option<u64>,
}

pub(super) fn token(args: &TokenArgs) -> Result<(), Failure> {
    match &args.command {
        TokenCommand::New { name, role, data } => {
            let secret = tokens::make(&data.dir(), name, *role)?;
            print(secret.reveal())?;
            note(&format!(
                "token of {name} with the role {}; rigd does not keep it, so that it cannot be shown \
                 again",
                role.name()
            ));
            if let Some(text) = protection(&data.dir()) {
                note(&text);
            }
            Ok(())
        }
        TokenCommand::List { data, output } => list(data, output),
        TokenCommand::Revoke { name, data } => {
            tokens::revoke(&data.dir(), name)?;
            note(&format!("the token of {name} opens nothing from now on"));
            Ok(())
        }
    }
}

fn list(data: &DataArgs, output: &OutputArgs) -> Result<(), Failure> {
    let (tokens, uses) = (tokens::read(&data.dir())?, tokens::uses(&data.dir()));
    let views: Vec<_> = tokens
        .into_iter()
        .map(|token| TokenView {
            used_unix_s: uses.get(&token.sha256).copied(),
            name: token.name,
            role: token.role,
            made_unix_s: token.made_unix_s,
        })
        .collect();
    if output.json {
        return print_json(&views);
    }
    let time = |unix_s: u64| {
        let at = i64::try_from(unix_s).ok().and_then(|s| Timestamp::from_second(s).ok());
        at.map_or_else(String::new, |at| at.strftime("%Y-%m-%d %H:%M UTC").to_string())
    };
    let row = |view: &TokenView| {
        let used = view.used_unix_s.map_or_else(|| "never".to_owned(), time);
        vec![view.name.clone(), view.role.name().to_owned(), time(view.made_unix_s), used]
    };
    let rows: Vec<_> = views.iter().map(row).collect();
    print(&columns(&["name", "role", "made", "last used"], &rows))
}

#[derive(Debug, Args)]
pub(super) struct OpenArgs {
    #[command(flatten)]
    data: DataArgs,
    /// Print the link instead of starting a browser
    #[arg(long)]
    print: bool,
}

/// A link that the daemon made.
#[derive(Debug, Deserialize)]
struct Link {
    path: String,
    valid_s: u64,
}

pub(super) fn open(args: &OpenArgs) -> Result<(), Failure> {
    let (client, link) = over_http(async {
        let client = Client::find(&args.data.dir(), &Operator::login())?;
        let link: Link = client.make("/api/v1/links").await?;
        Ok((client, link))
    })?;
    let url = format!("{}{}", client.origin(), link.path);
    if args.print || !starts_browser(&url) {
        note(&format!("this link works once, and for {} s:", link.valid_s));
        return print(&url);
    }
    Ok(())
}

/// Whether the desktop has taken the link.
fn starts_browser(url: &str) -> bool {
    let quiet = Stdio::null;
    let mut command = Command::new("xdg-open");
    let command = command.arg(url).stdin(quiet()).stdout(quiet()).stderr(quiet());
    command.status().is_ok_and(|status| status.success())
}

#[derive(Debug, Args)]
pub(super) struct LeaseArgs {
    /// Take the lease from another holder; the journal records it
    #[arg(long, conflicts_with = "give_back")]
    take_over: bool,
    /// Give the lease back
    #[arg(long)]
    give_back: bool,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
}

pub(super) fn lease(args: &LeaseArgs) -> Result<(), Failure> {
    let rig: RigView = over_http(async {
        let client = Client::find(&args.data.dir(), &args.operator.name())?;
        if args.take_over {
            client.post_json("/api/v1/lease", r#"{"take_over": true}"#).await?;
        } else if args.give_back {
            client.delete("/api/v1/lease").await?;
        }
        client.get("/api/v1/rig").await
    })?;
    print(&rig.lease.map_or_else(
        || "nobody has the lease; the next command takes it".to_owned(),
        |holder| format!("{} operates the rig", holder.name),
    ))
}
