//! Checks after a trial which promises were broken. The evidence is the building's truth, the disks
//! of the Journals and actuators, and the reports that people received; never the beliefs of a
//! planner.

use std::collections::BTreeMap;
use std::sync::PoisonError;

use acl::content::{GoalPhase, GoalStatus, Keep, Mailboxes, Record};

use crate::annex_nodes::InterfaceNode;
use crate::cluster::Cluster;
use crate::commands;
use crate::machine::SimulatedMachine;
use crate::people::GoalTrace;
use crate::script::BLINKS_UNTIL;

/// Maximum number of messages in a mailbox at rest: heartbeats of this instant.
const UNREAD_MAX: u64 = 16;

/// Returns all promises that were broken.
pub fn all_violations(
    city: &Cluster,
    goals: &[GoalStatus],
    mailboxes: &[Mailboxes],
    has_settled: bool,
) -> Vec<String> {
    let mut broken = city.world.broken.lock().unwrap_or_else(PoisonError::into_inner).clone();
    broken.extend(commands::violations(&city.command_log, &city.begun, &city.truth()));
    broken.extend(surplus_exchanges(city));
    let kept = kept(city);
    broken.extend(unread(mailboxes));
    broken.extend(outlived(&kept));
    for story in city.people.iter().flat_map(|person| person.traces.values()) {
        broken.extend(ended_by_blink(story));
        broken.extend(missing_outcome(story));
        broken.extend(unexplained(story));
        broken.extend(repeated(city, story));
        broken.extend(lost_goal(story, &kept, goals));
    }
    broken.extend(
        city.machines
            .iter()
            .filter_map(SimulatedMachine::annex_node)
            .flat_map(InterfaceNode::node_violations),
    );
    if !has_settled {
        let open = goals.iter().filter(|goal| !rests(goal));
        broken.extend(open.map(|goal| format!("{} never ends: {}", goal.goal, goal.phase_text())));
    }
    broken
}

/// Whether no agent has anything left to do.
pub fn is_at_rest(goals: &[GoalStatus]) -> bool {
    goals.iter().all(rests)
}

fn rests(goal: &GoalStatus) -> bool {
    goal.keep == Keep::Maintain && goal.phase == GoalPhase::Holding
}

/// Returns exchanges that are open beyond the expected ones. At rest only a person with a kept goal
/// waits: for the report that the goal no longer holds.
pub fn surplus_exchanges(city: &Cluster) -> Vec<String> {
    let mut waiting = Vec::new();
    for (agent, open) in city.machines.iter().flat_map(|post| post.agent_exchanges().open()) {
        let person = city.people.iter().find(|person| person.name == agent.as_str());
        let kept = person.map_or(0, |person| {
            let stories = person.traces.values();
            stories.filter(|story| story.is_listening && story.wish.keep == Keep::Maintain).count()
        });
        if open > kept {
            waiting.push(format!("`{agent}` waits in {open} exchanges, with {kept} goals kept"));
        }
    }
    waiting
}

/// Returns a message if a blink has ended a plan. A declined action is allowed: two replicas may
/// have taken one goal in that instant, and then the actuator decides.
fn ended_by_blink(story: &GoalTrace) -> Option<String> {
    let torn = story.received.iter().find(|(at, line)| {
        let is_torn = line.contains("planning anew") || line.contains("failed");
        *at < BLINKS_UNTIL
            && is_torn
            && !["cheaper plan", "declined"].iter().any(|other| line.contains(other))
    });
    torn.map(|(at, line)| format!("{}: broken by a blink at {at:.3?}: {line}", story.wish.goal))
}

/// Returns a message if a person with a terminal that still runs has not received a goal's outcome.
fn missing_outcome(story: &GoalTrace) -> Option<String> {
    let is_unheard = story.is_listening && !story.is_settled();
    let last = story.received.last().map_or("nothing", |(_, line)| line.as_str());
    is_unheard.then(|| format!("{}: its end was never received; last: {last}", story.wish.goal))
}

/// Returns a message if a failure was reported without a reason.
fn unexplained(story: &GoalTrace) -> Option<String> {
    let goal = &story.wish.goal;
    story.has_no_reason.then(|| format!("{goal}: it failed, and no reason was given"))
}

/// Returns a message if a person saw a confirmation twice. Messages may be delivered twice, but
/// people must see each confirmation once.
fn repeated(city: &Cluster, story: &GoalTrace) -> Option<String> {
    let said = city.confirmations.count(story.conversation.as_ref()?);
    let (heard, goal) = (story.reports, &story.wish.goal);
    (heard > said).then(|| format!("{goal}: {said} confirmations were sent, {heard} received"))
}

/// Returns a message if an accepted goal has neither ended nor is pursued, even if its terminal is
/// gone.
fn lost_goal(
    story: &GoalTrace,
    kept: &BTreeMap<String, Record>,
    goals: &[GoalStatus],
) -> Option<String> {
    let conversation = story.conversation.as_ref().filter(|_| story.is_accepted)?;
    let is_there = goals.iter().any(|goal| goal.conversation == *conversation);
    let record = kept.get(&format!("goal/{conversation}"));
    let has_ended = record.is_some_and(|record| !record.body["ended"].is_null());
    let was_heard = story.final_outcome.is_some_and(|end| end.is_final());
    let is_lost = !is_there && !has_ended && !was_heard;
    is_lost.then(|| {
        let record = record.map(|record| record.body.to_string());
        format!("{} ({conversation}) was accepted and is gone; kept: {record:?}", story.wish.goal)
    })
}

/// Returns a message for each mailbox with unread messages: at rest, all messages have been read.
fn unread(mailboxes: &[Mailboxes]) -> Vec<String> {
    let all = mailboxes.iter().flat_map(|of_daemon| &of_daemon.mailboxes);
    let full = all.filter(|mailbox| mailbox.waiting > UNREAD_MAX);
    full.map(|mailbox| format!("`{}` has {} messages unread", mailbox.agent, mailbox.waiting))
        .collect()
}

/// Returns a message for each goal that has ended and of which a Journal still keeps the plan.
/// Plans are the large records.
fn outlived(kept: &BTreeMap<String, Record>) -> Vec<String> {
    let has_ended = |goal: &str| {
        let record = kept.get(&format!("goal/{goal}"));
        record.is_none_or(|record| record.body.is_null() || !record.body["ended"].is_null())
    };
    let plans = kept.iter().filter(|(_, record)| !record.body.is_null());
    let plans = plans.filter_map(|(key, _)| key.strip_prefix("plan/"));
    let outlived = plans.filter(|goal| has_ended(goal));
    outlived.map(|goal| format!("the plan of {goal} is kept, which has ended")).collect()
}

/// Returns the newest version of each record on the Journals' disks.
fn kept(city: &Cluster) -> BTreeMap<String, Record> {
    let mut newest: BTreeMap<String, Record> = BTreeMap::new();
    for record in city.machines.iter().flat_map(|post| post.journal_records()) {
        let known = newest.get(&record.key).map(|known| known.version);
        if known.is_none_or(|known| known < record.version) {
            newest.insert(record.key.clone(), record);
        }
    }
    newest
}
