//! `althing mailbox`: shows how full the mailboxes of agents are, and how many messages have
//! overflowed.

use std::fmt::Write as _;
use std::process::ExitCode;

use acl::AgentId;
use acl::content::{MailboxStatus, Mailboxes};
use agent::Resource;
use serde_json::json;
use terminal::{exit, output};

use crate::cli::{MailboxArgs, WhoseArgs};
use crate::commands::client::{self, EcosystemView};

/// Runs `althing mailbox`: prints one line per mailbox.
pub(super) fn run(args: &MailboxArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let code = print(&link.view, &args.whose, json).await;
        (link, code)
    })
}

pub(crate) async fn print(view: &EcosystemView, whose: &WhoseArgs, json: bool) -> ExitCode {
    let agent = match whose.agent.as_deref().map(AgentId::new).transpose() {
        Ok(agent) => agent,
        Err(error) => return super::wrong(&error.to_string(), json),
    };
    let directory = view.directory(agent.as_ref()).await;
    let answers = view.ask(Resource::Mailbox, agent.clone()).await;
    let read = answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok());
    let mut daemons: Vec<Mailboxes> = read.collect();
    daemons.sort_by(|a, b| a.daemon.cmp(&b.daemon));
    match agent {
        Some(agent) if daemons.is_empty() => {
            let known = directory.iter().map(|resident| resident.agent.as_str());
            let near = pddl::nearest(agent.as_str(), known);
            let near = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
            client::unavailable(&format!("find `{agent}`: it is not here{near}"), json)
        }
        None if daemons.is_empty() => client::unavailable("reach any daemon", json),
        _ if json => output::print_json(&json!({ "daemons": daemons }), exit::DONE),
        _ => output::print(table(&daemons, whose.agent.is_none()), exit::DONE),
    }
}

fn table(daemons: &[Mailboxes], with_daemons: bool) -> String {
    let header = ["WAITING", "CAPACITY", "RECEIVED", "OVERFLOWED"];
    let [waiting, most, received, overflowed] = header;
    let mut text =
        format!("{:<30} {waiting:>8} {most:>9} {received:>10} {overflowed:>11}\n", "AGENT");
    for status in daemons.iter().flat_map(|daemon| &daemon.mailboxes) {
        let MailboxStatus { agent, waiting, waiting_max, received, overflowed } = status;
        let _ = writeln!(
            text,
            "{agent:<30} {waiting:>8} {waiting_max:>9} {received:>10} {overflowed:>11}"
        );
    }
    if with_daemons {
        let header = ["MISADDRESSED", "UNREADABLE", "NOT-SENT", "NOT-PERSISTED"];
        let [unknown, unreadable, not_sent, not_persisted] = header;
        let _ = writeln!(
            text,
            "\n{:<30} {unknown:>12} {unreadable:>12} {not_sent:>8} {not_persisted:>13}",
            "DAEMON"
        );
        for Mailboxes { daemon, unknown_receiver, unreadable, not_sent, not_persisted, .. } in
            daemons
        {
            let _ = writeln!(
                text,
                "{daemon:<30} {unknown_receiver:>12} {unreadable:>12} {not_sent:>8} {not_persisted:>13}"
            );
        }
        let rejecting = || daemons.iter().filter(|daemon| !daemon.rejected.is_empty());
        if rejecting().next().is_some() {
            let _ = writeln!(text, "\n{:<30} REJECTED", "DAEMON");
        }
        for Mailboxes { daemon, rejected, .. } in rejecting() {
            let kinds: Vec<_> =
                rejected.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
            let _ = writeln!(text, "{daemon:<30} {}", kinds.join(", "));
        }
    }
    text
}
