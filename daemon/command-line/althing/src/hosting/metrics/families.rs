//! The figures of a daemon as metrics, with their names, units and labels (docs/metrics.md).
//!
//! Labels have kinds and outcomes as values, and never names, so that their number is the same in
//! every building.

use std::time::Duration;

use agent::{ActivityCounts, DaemonFigures, DurationCounts};
use machine::ProcessFigures;
use metrics_endpoint::MetricFamily;

/// Returns all metrics of a daemon with these figures.
pub(super) fn all(
    figures: &DaemonFigures,
    process: &ProcessFigures,
    stops: usize,
    is_healthy: bool,
) -> Vec<MetricFamily> {
    let daemon = daemon(figures, stops, is_healthy);
    let agents = [messages(figures), failures(figures), goals(&figures.activity)];
    daemon.into_iter().chain(agents.into_iter().flatten()).chain(of_process(process)).collect()
}

fn daemon(figures: &DaemonFigures, stops: usize, is_healthy: bool) -> Vec<MetricFamily> {
    let version = env!("CARGO_PKG_VERSION");
    let activity = &figures.activity;
    vec![
        MetricFamily::gauge("althing_build_info", "Version of the program; the value is always 1.")
            .labelled(&[("version", version)], 1.0),
        MetricFamily::gauge(
            "althing_healthy",
            "Whether /healthz reports no problem: 1 if so, otherwise 0.",
        )
        .with(f64::from(u8::from(is_healthy))),
        MetricFamily::gauge("althing_agents_hosted", "Agents that this daemon hosts.")
            .with(figures.agents_hosted as f64),
        MetricFamily::gauge(
            "althing_agents_present",
            "Agents of the whole ecosystem that this daemon sees.",
        )
        .with(figures.agents_present as f64),
        MetricFamily::gauge(
            "althing_daemons_present",
            "Daemons that host agents which this daemon sees, itself included.",
        )
        .with(figures.daemons_present as f64),
        MetricFamily::gauge("althing_stops_in_force", "Stops that are in force at this daemon.")
            .with(stops as f64),
        MetricFamily::gauge(
            "althing_certificate_remaining_seconds",
            "Time until the certificate of this daemon ends; absent without [security].",
        )
        .in_unit("seconds")
        .with_known(figures.certificate_left.map(|left| left.as_secs() as f64)),
        MetricFamily::counter(
            "althing_agent_restarts_total",
            "Times that an agent of this daemon was started again after a failure.",
        )
        .with(activity.agent_restarts as f64),
        MetricFamily::counter(
            "althing_plugin_restarts_total",
            "Times that the process of a plugin was started again after a failure.",
        )
        .with(activity.plugin_restarts as f64),
        distribution(
            MetricFamily::durations(
                "althing_heartbeat_gap_seconds",
                "Time between two heartbeats of one agent, as this daemon received them.",
            ),
            &[],
            &activity.heartbeat_gaps,
        ),
    ]
}

fn messages(figures: &DaemonFigures) -> Vec<MetricFamily> {
    let DaemonFigures { activity, mailboxes, rejected, .. } = figures;
    let of = |counts: &[(acl::Performative, u64)]| -> Vec<(&'static str, u64)> {
        counts.iter().map(|(performative, count)| (performative.as_str(), *count)).collect()
    };
    vec![
        MetricFamily::counter(
            "althing_messages_sent_total",
            "Messages that agents of this daemon have sent, receipts not included.",
        )
        .by("performative", of(&activity.sent)),
        MetricFamily::counter(
            "althing_messages_received_total",
            "Messages that have arrived at this daemon, receipts not included.",
        )
        .by("performative", of(&activity.received)),
        MetricFamily::counter(
            "althing_messages_rejected_total",
            "Messages, links and presence tokens that were rejected, by kind of violation.",
        )
        .by("kind", rejected.iter().map(|(kind, count)| (kind.as_str(), *count))),
        MetricFamily::gauge(
            "althing_mailbox_messages",
            "Messages that wait in the mailboxes of all agents of this daemon.",
        )
        .with(mailboxes.waiting as f64),
        MetricFamily::gauge(
            "althing_mailbox_fullest_ratio",
            "How full the fullest mailbox of an agent is, from 0 to 1.",
        )
        .in_unit("ratio")
        .with(mailboxes.fullest),
        MetricFamily::counter(
            "althing_mailbox_overflows_total",
            "Messages that have found the mailbox of their receiver full.",
        )
        .with(mailboxes.overflowed as f64),
    ]
}

fn failures(figures: &DaemonFigures) -> Vec<MetricFamily> {
    let failures = &figures.failures;
    vec![
        MetricFamily::counter(
            "althing_messages_unreadable_total",
            "Broadcasts that could not be decoded, or that named another sender.",
        )
        .with(failures.unreadable as f64),
        MetricFamily::counter(
            "althing_messages_unknown_receiver_total",
            "Messages to agents that this daemon does not host.",
        )
        .with(failures.unknown_receiver as f64),
        MetricFamily::counter(
            "althing_messages_not_sent_total",
            "Messages that the network layer did not take.",
        )
        .with(failures.not_sent as f64),
        MetricFamily::counter(
            "althing_records_not_persisted_total",
            "Records that could not be written to the disk.",
        )
        .with(failures.not_persisted as f64),
    ]
}

fn goals(activity: &ActivityCounts) -> Vec<MetricFamily> {
    let phases = activity.phases.iter().map(|(phase, count)| (phase.as_str(), *count));
    let ended: Vec<_> =
        activity.goals.iter().map(|(outcome, count)| (outcome.to_string(), *count)).collect();
    let rounds = MetricFamily::counter(
        "althing_planning_rounds_total",
        "Rounds of planning that have ended, by planning mode and result.",
    );
    let rounds = activity.planning_rounds.iter().fold(rounds, |family, (mode, result, count)| {
        let labels = [("mode", mode.as_str()), ("result", result.as_str())];
        family.labelled(&labels, *count as f64)
    });
    let planning = MetricFamily::durations(
        "althing_planning_seconds",
        "Time that a round of planning took, from the request for a plan to its answer.",
    );
    let planning = activity.planning.iter().fold(planning, |family, (mode, durations)| {
        distribution(family, &[("mode", mode.as_str())], durations)
    });
    let steps = activity.steps.iter().map(|(outcome, count)| (outcome.as_str(), *count));
    vec![
        MetricFamily::gauge(
            "althing_goals",
            "Goals that the Plan Requester of this daemon pursues.",
        )
        .by("phase", phases),
        MetricFamily::counter("althing_goals_ended_total", "Goals that have ended, by outcome.")
            .by("outcome", ended.iter().map(|(outcome, count)| (outcome.as_str(), *count))),
        rounds,
        planning,
        MetricFamily::counter(
            "althing_steps_total",
            "Steps of plans that have ended, by outcome, at the Plan Executor of this daemon.",
        )
        .by("outcome", steps),
    ]
}

fn of_process(process: &ProcessFigures) -> Vec<MetricFamily> {
    let count = |value: Option<u64>| value.map(|value| value as f64);
    let seconds = |value: Option<Duration>| value.map(|value| value.as_secs_f64());
    vec![
        MetricFamily::counter(
            "process_cpu_seconds_total",
            "Processor time that the process has used, in user and system mode.",
        )
        .with_known(seconds(process.cpu)),
        MetricFamily::gauge("process_resident_memory_bytes", "Memory that the process uses.")
            .in_unit("bytes")
            .with_known(count(process.memory_resident)),
        MetricFamily::gauge("process_virtual_memory_bytes", "Address space of the process.")
            .in_unit("bytes")
            .with_known(count(process.memory_virtual)),
        MetricFamily::gauge(
            "process_start_time_seconds",
            "Time at which the process started, since the Unix epoch.",
        )
        .in_unit("seconds")
        .with_known(seconds(process.started)),
        MetricFamily::gauge("process_open_fds", "Files that the process has open.")
            .with_known(count(process.open_files)),
        MetricFamily::gauge("process_max_fds", "Files that the process may have open.")
            .with_known(count(process.open_files_max)),
        MetricFamily::gauge("process_threads", "Threads of the process.")
            .with_known(count(process.threads)),
    ]
}

fn distribution(
    family: MetricFamily,
    labels: &[(&'static str, &str)],
    durations: &DurationCounts,
) -> MetricFamily {
    let DurationCounts { at_most, count, sum } = durations;
    family.distributed(labels, at_most, *count, *sum)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
    use agent::{AgentSettings, MessageRouter};
    use substrate::{Inbound as _, Presence, Resident};

    use super::*;

    fn router_with(agents: u64) -> Arc<MessageRouter> {
        let ecosystem = EcosystemId::new("office").expect("a name");
        let daemon = |name: u64| DaemonId::new(&format!("d{name}")).expect("a name");
        let router = MessageRouter::new(ecosystem, daemon(0), AgentSettings::default());
        for number in 0..agents {
            router.presence(Presence::Joined(Resident {
                agent: AgentId::new(&format!("lamp-{number}")).expect("a name"),
                daemon: daemon(number % 100),
                incarnation: Incarnation(number + 1),
            }));
        }
        router
    }

    fn samples(router: &MessageRouter) -> Vec<(&'static str, usize)> {
        let families = all(&router.figures(), &ProcessFigures::default(), 0, true);
        families.iter().map(|family| (family.name, family.samples.len())).collect()
    }

    #[test]
    fn ten_thousand_agents_have_as_many_samples_as_one() {
        let (one, many) = (router_with(1), router_with(10_000));
        assert_eq!(many.figures().agents_present, 10_000);
        assert_eq!(many.figures().daemons_present, 100);
        assert_eq!(samples(&many), samples(&one));
        let total: usize = samples(&many).iter().map(|(_, samples)| samples).sum();
        assert!(total < 200, "{total}");
    }

    #[test]
    fn names_and_units_follow_the_rules_of_prometheus() {
        let families = all(&router_with(1).figures(), &ProcessFigures::default(), 0, true);
        for family in &families {
            let MetricFamily { name, help, unit, kind, .. } = family;
            let is_counter = *kind == metrics_endpoint::MetricKind::Counter;
            assert_eq!(is_counter, name.ends_with("_total"), "{name}");
            assert!(name.starts_with("althing_") || name.starts_with("process_"), "{name}");
            let base = name.trim_end_matches("_total");
            assert!(unit.is_empty() || base.ends_with(&format!("_{unit}")), "{name} in {unit}");
            assert!(help.ends_with('.'), "{name}: {help}");
        }
        let mut names: Vec<_> = families.iter().map(|family| family.name).collect();
        names.sort_unstable();
        let count = names.len();
        names.dedup();
        assert_eq!(names.len(), count, "each name occurs once");
    }
}
