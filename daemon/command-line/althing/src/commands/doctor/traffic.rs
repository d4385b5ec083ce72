//! Judges the counters of daemons: messages that overflow, that are not sent or not stored, and that
//! are rejected. Counters only grow, so each is read twice: one that grows is a problem now, one
//! that stands is the note of an earlier one.

use std::collections::BTreeMap;

use acl::DaemonId;
use acl::content::Mailboxes;

use super::finding::{CheckFinding, DoctorCheck, Remedy};
use super::running::EcosystemAnswers;
use super::subject::DoctorSubject;
use crate::commands::client::shell_word;
use crate::hosting;

/// Value of a counter, and by how much it has grown while this command looked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct CounterGrowth {
    count: u64,
    grown: u64,
}

impl CounterGrowth {
    fn of(before: u64, now: u64) -> CounterGrowth {
        // A daemon that has started anew begins at zero.
        CounterGrowth { count: now, grown: now.saturating_sub(before) }
    }
}

/// Judges the counters of all daemons.
pub(super) fn judge(subject: &DoctorSubject, answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let [before, now] = &answers.mailboxes;
    let before: BTreeMap<&DaemonId, &Mailboxes> =
        before.iter().map(|mailboxes| (&mailboxes.daemon, mailboxes)).collect();
    let words = subject.words();
    let mut findings = Vec::new();
    for daemon in now {
        let before = before.get(&daemon.daemon).copied();
        findings.extend(overflows(daemon, before, &words));
        findings.extend(undelivered(daemon, before, &words));
        findings.extend(rejected(daemon, before, subject));
    }
    let calm = [
        (DoctorCheck::Mailboxes, "no mailbox has overflowed"),
        (DoctorCheck::NotSent, "every message was sent"),
        (DoctorCheck::NotPersisted, "every record was stored"),
        (DoctorCheck::Rejected, "no message was rejected"),
    ];
    for (check, text) in calm {
        if !findings.iter().any(|finding| finding.check == check) {
            findings.push(check.ok(text));
        }
    }
    findings
}

fn finding(
    check: DoctorCheck,
    counted: CounterGrowth,
    text: String,
    remedy: Option<Remedy>,
) -> Option<CheckFinding> {
    match counted {
        CounterGrowth { count: 0, .. } => None,
        CounterGrowth { grown: 0, .. } => {
            Some(check.note(format!("{text} since the start, none now"), remedy))
        }
        CounterGrowth { grown, .. } => {
            Some(check.problem(format!("{text}, {grown} of them just now"), remedy))
        }
    }
}

fn overflows(now: &Mailboxes, before: Option<&Mailboxes>, words: &str) -> Vec<CheckFinding> {
    let overflowed = |mailboxes: &Mailboxes, agent: &acl::AgentId| {
        let found = mailboxes.mailboxes.iter().find(|mailbox| mailbox.agent == *agent);
        found.map_or(0, |mailbox| mailbox.overflowed)
    };
    let judged = now.mailboxes.iter().filter_map(|mailbox| {
        let agent = &mailbox.agent;
        let earlier = before.map_or(mailbox.overflowed, |before| overflowed(before, agent));
        let counted = CounterGrowth::of(earlier, mailbox.overflowed);
        let text = format!("{} messages did not fit into the mailbox of `{agent}`", counted.count);
        let look = Remedy::look(format!("althing mailbox {agent}{words}"));
        finding(DoctorCheck::Mailboxes, counted, text, look)
    });
    judged.collect()
}

fn undelivered(now: &Mailboxes, before: Option<&Mailboxes>, words: &str) -> Vec<CheckFinding> {
    let daemon = &now.daemon;
    let earlier = before.unwrap_or(now);
    let not_sent = CounterGrowth::of(earlier.not_sent, now.not_sent);
    let text = format!("`{daemon}` could not send {} messages", not_sent.count);
    let look = Remedy::look(format!("althing mailbox{words}"));
    let not_sent = finding(DoctorCheck::NotSent, not_sent, text, look);
    let not_persisted = CounterGrowth::of(earlier.not_persisted, now.not_persisted);
    let text = format!("`{daemon}` could not store {} records", not_persisted.count);
    let folder = hosting::state_base();
    let look = Remedy::look(format!("df -h {}", shell_word(&folder.to_string_lossy())));
    let not_persisted = finding(DoctorCheck::NotPersisted, not_persisted, text, look);
    [not_sent, not_persisted].into_iter().flatten().collect()
}

/// Judges the rejected messages of a daemon, by kind.
fn rejected(
    now: &Mailboxes,
    before: Option<&Mailboxes>,
    subject: &DoctorSubject,
) -> Vec<CheckFinding> {
    let earlier = before.unwrap_or(now);
    let judged = now.rejected.iter().filter_map(|(kind, count)| {
        let before = earlier.rejected.get(kind).copied().unwrap_or_default();
        let counted = CounterGrowth::of(before, *count);
        let (why, look) = rejection(kind, subject);
        let text = format!("`{}` has rejected {count} messages, {kind}: {why}", now.daemon);
        finding(DoctorCheck::Rejected, counted, text, Remedy::look(look))
    });
    judged.collect()
}

/// Returns the meaning of a kind of rejection, and the command that shows more of it.
fn rejection(kind: &str, subject: &DoctorSubject) -> (&'static str, String) {
    let (words, of_ecosystem) = (subject.words(), subject.ecosystem_words());
    let certificates = format!("althing cert show{of_ecosystem}");
    match kind {
        "unsigned" => ("a daemon or guest without a certificate", certificates),
        "unknown" => ("a certificate of another authority", certificates),
        "forged" => ("the signature is wrong", certificates),
        "replayed" => ("they were recorded and sent again", certificates),
        "revoked" => ("the certificate is revoked", certificates),
        "refused-link" => ("another machine may not link", certificates),
        "unauthorized" => {
            ("[rights] of the file does not allow them", format!("althing watch{words}"))
        }
        "other-version" => ("the sender has another version", format!("althing agents{words}")),
        "oversized" => ("they are too long", format!("althing watch{words}")),
        "flooded" => ("a daemon sends too many a second", format!("althing mailbox{words}")),
        _ => ("they cannot be read", format!("althing watch{words}")),
    }
}

#[cfg(test)]
mod tests {
    use acl::AgentId;
    use acl::content::MailboxStatus;

    use super::*;
    use crate::commands::doctor::finding::CheckVerdict;

    fn mailboxes(overflowed: u64, not_sent: u64) -> Mailboxes {
        let agent = AgentId::new("robot-1").expect("a name");
        let status = MailboxStatus { agent, waiting: 0, waiting_max: 9, received: 90, overflowed };
        Mailboxes {
            daemon: DaemonId::new("hall").expect("a name"),
            mailboxes: vec![status],
            unknown_receiver: 0,
            unreadable: 0,
            not_sent,
            not_persisted: 0,
            rejected: BTreeMap::new(),
        }
    }

    #[test]
    fn a_counter_that_stands_is_a_note_and_one_that_grows_a_problem() {
        let (before, now) = (mailboxes(3, 1), mailboxes(3, 5));
        assert!(overflows(&mailboxes(0, 0), Some(&before), "").is_empty());
        let stands = overflows(&now, Some(&before), " --ecosystem lab");
        assert_eq!(stands[0].verdict, CheckVerdict::Note);
        let look = Remedy::look("althing mailbox robot-1 --ecosystem lab");
        assert_eq!(stands[0].remedy, look);
        let grows = undelivered(&now, Some(&before), "");
        assert_eq!(grows[0].verdict, CheckVerdict::Problem);
        assert!(grows[0].text.contains("5 messages, 4 of them just now"), "{grows:?}");
        // A daemon that was not there before has no growth that is known.
        assert_eq!(undelivered(&now, None, "")[0].verdict, CheckVerdict::Note);
    }
}
