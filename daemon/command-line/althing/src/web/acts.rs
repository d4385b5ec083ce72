//! Carries out what a person asks for on a page, and says in one sentence what has come of it.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use accounts::{Person, PersonRight};
use acl::content::{
    Achieve, AnswerQuestion, ChangeState, Keep, Outcome, PersonsAnswer, Reason, ReleaseStops,
    Report, Request, Stop,
};
use acl::{AgentId, ConversationId, IDENTIFIER_BYTES_MAX};
use keyboard::{GoalRequest, UserEvent, UserRequest};
use plan_requester::{DryRunResult, DryRunStep};
use serde_json::json;
use terminal::render::plural;
use web_page::{ActOutcome, GoalMode, PageAct};

use super::act_sentences::{fixed, followed, late, outcome};
use super::answered::AnsweredQuestions;
use super::page_view::PageView;
use super::person_agents::{FollowUntil, FollowedRequest, PersonAgents};
use crate::asking::stops::{self, StopAnswer, StopAnswers};
use crate::asking::{dry_run, questions, wishes};
use crate::ecosystem_view::EcosystemView;
use crate::observing;

/// How long the first answer to a goal or an action is awaited. After that the page shows what comes
/// of it.
const FIRST_ANSWER_WITHIN: Duration = Duration::from_secs(5);

/// How long the end of a change or an answer is awaited, which need no planning.
const ENDED_WITHIN: Duration = Duration::from_secs(10);

/// Longest time limit of a goal that is asked for on a page.
const GOAL_LIMIT_MAX: Duration = Duration::from_secs(24 * 3_600);

/// The words if no answer to a goal or an action has come yet: the key of the message and the
/// sentence.
const ASKED: (&str, &str) = ("act.asked", "it is asked for, and there is no answer yet");

/// Beginning of the names of the Doorkeepers, one per daemon.
const DOORKEEPER_PREFIX: &str = "doorkeeper-";

/// Maximum number of agents that a sentence names; the others are counted.
const NAMED_MAX: usize = 5;

/// The means by which acts are carried out.
pub(super) struct ActMeans {
    pub(super) view: EcosystemView,
    pub(super) page: Arc<PageView>,
    pub(super) agents: Arc<PersonAgents>,
    pub(super) answered: AnsweredQuestions,
}

/// Whether an agent is a Doorkeeper. The answer to its question admits agents or forbids them.
pub(super) fn is_doorkeeper(agent: &AgentId) -> bool {
    agent.as_str().starts_with(DOORKEEPER_PREFIX)
}

/// An act that is not carried out, with the reason for the person.
type NotDone = String;

/// Carries out an act of a person. The server has checked the rights of the person.
pub(super) async fn carry_out(means: &ActMeans, person: &Person, act: PageAct) -> ActOutcome {
    let done = match act {
        PageAct::Goal { goal, mode, within_ms } => means.goal(person, &goal, mode, within_ms).await,
        PageAct::DryRun { goal, mode } => means.dry_run(&goal, mode).await,
        PageAct::CancelGoal { conversation } => means.cancel(person, &conversation).await,
        PageAct::Action { agent, action } => means.action(person, &agent, &action).await,
        PageAct::Set { fact } => means.set(person, &fact).await,
        PageAct::Answer { keyboard, question, text } => {
            means.answer(person, &format!("{keyboard}/{question}"), text).await
        }
        PageAct::Admit { agent, allow } => means.admit(person, &agent, allow).await,
        PageAct::Stop { names, because } => means.stop(person, names, because).await,
        PageAct::Release { ids } => means.release(person, ids).await,
    };
    done.unwrap_or_else(|problem| outcome(false, problem))
}

// === impl ActMeans ===

impl ActMeans {
    // === goals ===

    /// Returns the goal that a person has written: PDDL, or a name of the ecosystem file.
    fn wish(&self, goal: &str, mode: GoalMode) -> Result<GoalRequest, NotDone> {
        let wish = wishes::goal(self.view.ecosystem.as_deref(), goal)?;
        let keep = match mode {
            GoalMode::Reach => Keep::Achieve,
            GoalMode::Keep => Keep::Maintain,
        };
        Ok(GoalRequest { keep, ..wish })
    }

    async fn goal(
        &self,
        person: &Person,
        goal: &str,
        mode: GoalMode,
        within_ms: Option<u64>,
    ) -> Result<ActOutcome, NotDone> {
        let wish = self.wish(goal, mode)?;
        let limit = limit(mode, within_ms)?;
        let GoalRequest { goal, keep, priority, partition } = wish.clone();
        let achieve = Request::Achieve(Achieve { goal, keep, priority, partition });
        self.agents.check_rights(&self.agents.name_of(&person.name)?, &achieve)?;
        // Without a place for its limit, the goal must not begin.
        let limited = match limit {
            Some(limit) => Some((limit, self.agents.limit_place()?)),
            None => None,
        };
        let request = UserRequest::RequestGoal(wish);
        let asked = self.ask(person, request, FollowUntil::FirstAnswer).await?;
        let is_over = asked.answer.as_ref().is_some_and(UserEvent::is_final);
        let conversation = asked.conversation.clone();
        let mut done = followed(asked, ASKED);
        if let (Some((limit, place)), Some(id), false) = (limited, conversation, is_over) {
            let (page, goal) = (Arc::clone(&self.page), id.clone());
            let has_ended = move || {
                let now = observing::now();
                page.read(|view| view.goal(&goal, now).is_some_and(|it| it.row.ended_at.is_some()))
            };
            self.agents.limit_goal(&person.name, id, limit, place, has_ended);
            let limit = humantime::format_duration(limit);
            done.sentence +=
                &format!("; this daemon cancels it if it is not reached within {limit}");
            done.message = None;
        }
        Ok(done)
    }

    async fn cancel(&self, person: &Person, conversation: &str) -> Result<ActOutcome, NotDone> {
        if conversation.len() > IDENTIFIER_BYTES_MAX || conversation.contains(char::is_control) {
            return Err("a conversation is a short text without control characters".to_owned());
        }
        // Cancelling a goal of another person needs the same right as asking for goals.
        self.agents.check_rights(&self.agents.name_of(&person.name)?, &any_goal())?;
        let conversation = ConversationId::new(conversation);
        let request = UserRequest::Cancel(conversation.clone());
        let asked = self.ask(person, request, FollowUntil::FirstAnswer).await?;
        // The end of a goal by a cancellation is what was asked for.
        let is_cancelled = matches!(
            &asked.answer,
            Some(UserEvent::Report(_, Report { outcome: Outcome::Cancelled, .. }))
        );
        let waiting = ("act.cancelling", "cancelling it is asked for, and there is no answer yet");
        let done = followed(asked, waiting);
        Ok(ActOutcome {
            ok: done.ok || is_cancelled,
            conversation: Some(conversation.to_string()),
            ..done
        })
    }

    async fn dry_run(&self, goal: &str, mode: GoalMode) -> Result<ActOutcome, NotDone> {
        let wish = self.wish(goal, mode)?;
        let found = dry_run::dry_run(&self.view, &wish).await;
        let mut found = found.map_err(|problem| format!("failed to {problem}"))?;
        let times = self.usual_times(&found);
        found.add_times(|step| times.get(&(step.agent.clone(), action_of(step))).copied());
        let done = match (&found.problem, found.holds, found.cost) {
            (Some(problem), ..) => outcome(false, problem.clone()),
            (None, true, _) => {
                fixed(true, "act.holds", &[], "it holds already; nothing would be done")
            }
            (None, false, cost) => {
                let (steps, cost) = (found.plan.len(), cost.unwrap_or_default());
                let sentence = format!("a plan of {}, cost {cost}", plural(steps, "step"));
                fixed(true, "act.plan", &[("n", json!(steps)), ("cost", json!(cost))], sentence)
            }
        };
        Ok(ActOutcome { detail: json!(found), ..done })
    }

    /// Returns the usual times of the actions in a plan, by agent and action, as far as runs of them
    /// were observed.
    fn usual_times(&self, found: &DryRunResult) -> BTreeMap<(String, String), u64> {
        let mut times = BTreeMap::new();
        self.page.read(|view| {
            for step in &found.plan {
                let Ok(agent) = AgentId::new(&step.agent) else { continue };
                let Some(detail) = view.agent(&agent, observing::now()) else { continue };
                let actions = detail.actions.into_iter();
                times.extend(actions.filter_map(|action| {
                    Some(((step.agent.clone(), action.action), action.usual_ms?))
                }));
            }
        });
        times
    }

    // === actions, facts, answers ===

    async fn action(
        &self,
        person: &Person,
        agent: &str,
        action: &str,
    ) -> Result<ActOutcome, NotDone> {
        let request = wishes::action(action)?;
        let step = pddl::parse_step(action).into_result().ok();
        let actor = step.as_ref().and_then(|step| step.arguments.first());
        if actor.is_none_or(|actor| actor.as_str() != agent) {
            return Err(format!(
                "`{action}` is no action of `{agent}`: its first argument is the agent that acts"
            ));
        }
        // An action is requested from the Plan Executor as a plan; the right for it is that for
        // goals.
        self.agents.check_rights(&self.agents.name_of(&person.name)?, &any_goal())?;
        let asked = self.ask(person, request, FollowUntil::FirstAnswer).await?;
        Ok(followed(asked, ASKED))
    }

    async fn set(&self, person: &Person, fact: &str) -> Result<ActOutcome, NotDone> {
        let change: ChangeState = wishes::change(fact, false)?;
        let own = self.agents.name_of(&person.name)?;
        self.agents.check_rights(&own, &Request::ChangeState(change.clone()))?;
        let asked = self.ask(person, UserRequest::Set(change), FollowUntil::End).await?;
        let waiting = ("act.changing", "the change is asked for, and there is no answer yet");
        Ok(followed(asked, waiting))
    }

    async fn answer(
        &self,
        person: &Person,
        question: &str,
        text: String,
    ) -> Result<ActOutcome, NotDone> {
        self.answered.begin(question, &person.name);
        let done = self.try_answer(person, question, text).await;
        match done {
            Ok(Some(done)) if done.ok => Ok(done),
            done => {
                let earlier = self.answered.late(question, &person.name);
                Ok(done?.unwrap_or_else(|| late(&earlier)))
            }
        }
    }

    /// Answers a question; returns `None` if it is not open any more.
    async fn try_answer(
        &self,
        person: &Person,
        question: &str,
        text: String,
    ) -> Result<Option<ActOutcome>, NotDone> {
        let Ok(open) = questions::meant(&self.view, question).await else { return Ok(None) };
        // The number may be that of another question by now.
        if person.screen.as_deref().is_some_and(|agent| agent != open.from.as_str()) {
            return Ok(None);
        }
        if is_doorkeeper(&open.from) && !person.may(PersonRight::Admit) {
            return Err("this question is about agents that want to take part, and you may not \
                        `admit` them"
                .to_owned());
        }
        let answer = PersonsAnswer::plain(String::new());
        let request = Request::AnswerQuestion(AnswerQuestion { question: open.question, answer });
        self.agents.check_rights(&self.agents.name_of(&person.name)?, &request)?;
        let request = questions::reply(open, text);
        let asked = self.ask(person, request, FollowUntil::End).await?;
        let is_over = matches!(
            &asked.answer,
            Some(UserEvent::Refused(_, refusal)) if refusal.reason == Reason::Unknown
        );
        if is_over {
            return Ok(None);
        }
        let waiting =
            ("act.answering", "the answer was sent, and its receipt was not confirmed yet");
        let done = followed(asked, waiting);
        // The conversation of an answer is of no interest to those that ask for it.
        Ok(Some(ActOutcome { conversation: None, ..done }))
    }

    /// Answers the question of the Doorkeeper about a discovered agent.
    async fn admit(
        &self,
        person: &Person,
        agent: &str,
        allow: bool,
    ) -> Result<ActOutcome, NotDone> {
        let named = format!("`{agent}` (");
        let open = questions::questions(&self.view).await;
        let about = open
            .into_iter()
            .find(|question| is_doorkeeper(&question.from) && question.text.contains(&named));
        let Some(question) = about else {
            return Err(format!(
                "nobody asks whether `{agent}` may take part: it was decided already, or `admit` in \
                 [plugins] of the ecosystem file is not \"ask\""
            ));
        };
        let text = format!("{} {agent}", if allow { "yes" } else { "no" });
        let id = format!("{}/{}", question.keyboard, question.question);
        let done = self.answer(person, &id, text).await?;
        let named = [("agent", json!(agent))];
        Ok(match (done.ok, allow) {
            (true, true) => fixed(true, "act.admitted", &named, format!("`{agent}` may take part")),
            (true, false) => {
                fixed(true, "act.rejected", &named, format!("`{agent}` may not take part"))
            }
            (false, _) => done,
        })
    }

    async fn ask(
        &self,
        person: &Person,
        request: UserRequest,
        until: FollowUntil,
    ) -> Result<FollowedRequest, NotDone> {
        let patience = match until {
            FollowUntil::FirstAnswer => FIRST_ANSWER_WITHIN,
            FollowUntil::End => ENDED_WITHIN,
        };
        self.agents.ask(&person.name, request, until, patience).await
    }

    // === stops ===

    async fn stop(
        &self,
        person: &Person,
        names: Vec<String>,
        because: String,
    ) -> Result<ActOutcome, NotDone> {
        let mut earlier = self.repeated_stop(person, &names);
        let (id, answers) = loop {
            let (is_repeated, by) =
                (earlier.is_some(), self.agents.new_name(&person.name, "stop")?);
            let stop = match earlier.take() {
                Some(earlier) => earlier,
                None => {
                    let id = stops::new_id().map_err(|problem| format!("failed to {problem}"))?;
                    let (scope, why) = (names.clone(), because.clone());
                    Stop { id, scope, by: by.clone(), why }
                }
            };
            let id = stop.id.clone();
            let answers = stops::send_to_all(&self.view, by, &Request::Stop(stop)).await;
            let answers = answers.map_err(|problem| format!("failed to {problem}"))?;
            // It may just have been released.
            if !is_repeated || answers.values().all(|it| StopAnswer::is_obeyed(it.as_ref())) {
                break (id, answers);
            }
        };
        let concerns_any = answers.values().any(|it| StopAnswer::is_concerned(it.as_ref()));
        let is_unknown = |name: &&String| !stops::is_known(&self.view, name, concerns_any);
        let unknown: Vec<&String> = names.iter().filter(is_unknown).collect();
        if !unknown.is_empty() {
            return Err(unknown_names(&unknown, concerns_any));
        }
        let what = match names.as_slice() {
            [] => StopWords { key: "act.stopped-all", verb: "stopped", what: "everything".into() },
            names => StopWords { key: "act.stopped", verb: "stopped", what: names.join(", ") },
        };
        Ok(self.stopped(&answers, &what, Some(&id)))
    }

    /// Returns the stop of the same names that the person has in force already. It is sent again: a
    /// key that is pressed often must not fill the list of stops, which then become one of everything.
    fn repeated_stop(&self, person: &Person, names: &[String]) -> Option<Stop> {
        let own = format!("{}-stop", person.name);
        let stops = self.page.read(|view| view.stops(observing::now()));
        let is_own = |stop: &Stop| stop.scope == names && stop.by.as_str().starts_with(&own);
        stops.into_iter().map(|row| row.stop).find(is_own)
    }

    async fn release(&self, person: &Person, ids: Vec<String>) -> Result<ActOutcome, NotDone> {
        let in_force = stops::in_force(&stops::states(&self.view).await);
        if let Some(unknown) = ids.iter().find(|id| !in_force.contains_key(*id)) {
            return Err(format!("there is no stop `{unknown}`: it may be released already"));
        }
        if ids.is_empty() {
            return Err("name the stops to release".to_owned());
        }
        let own = self.agents.new_name(&person.name, "stop")?;
        let request = Request::ReleaseStops(ReleaseStops { ids: ids.clone() });
        self.agents.check_rights(&own, &request)?;
        let answers = stops::send_to_all(&self.view, own, &request).await;
        let answers = answers.map_err(|problem| format!("failed to {problem}"))?;
        let what = StopWords { key: "act.released", verb: "released", what: ids.join(", ") };
        Ok(self.stopped(&answers, &what, None))
    }

    /// Returns the outcome of a stop or a release, with what each agent says.
    fn stopped(&self, answers: &StopAnswers, words: &StopWords, id: Option<&str>) -> ActOutcome {
        let absent = stops::absent(&self.view);
        let effect = |answer: &Option<StopAnswer>| match answer {
            Some(StopAnswer::Done(_)) => "done",
            Some(StopAnswer::Ended(_)) => "ended",
            Some(StopAnswer::Still(_)) => "still",
            Some(StopAnswer::Unconcerned(_)) => "unconcerned",
            Some(StopAnswer::Doubtful(_)) => "doubtful",
            Some(StopAnswer::Declined(_)) => "declined",
            None => "silent",
        };
        let row = |(agent, answer): (&AgentId, &Option<StopAnswer>)| {
            let detail = StopAnswer::describe(answer.as_ref());
            json!({ "agent": agent, "effect": effect(answer), "detail": detail })
        };
        let missing = absent.iter().map(|agent| {
            json!({ "agent": agent, "effect": "absent", "detail": "NOT REACHED: it is absent" })
        });
        let rows: Vec<_> = answers.iter().map(row).chain(missing).collect();
        let is_doubtful =
            |(_, answer): &(&AgentId, &Option<StopAnswer>)| !StopAnswer::is_obeyed(answer.as_ref());
        let doubtful = answers.iter().filter(is_doubtful).map(|(agent, _)| agent);
        let doubtful: Vec<_> = doubtful.chain(&absent).map(|agent| format!("`{agent}`")).collect();
        let concerned = answers.values().filter(|it| StopAnswer::is_concerned(it.as_ref()));
        let done = words.outcome(concerned.count(), &doubtful);
        ActOutcome { detail: json!({ "id": id, "agents": rows }), ..done }
    }
}

/// The words for a stop or a release: the key of the message, and the parts of the sentence.
struct StopWords {
    key: &'static str,
    verb: &'static str,
    what: String,
}

impl StopWords {
    /// Returns the outcome if `count` agents have answered, and these are doubtful.
    fn outcome(&self, count: usize, doubtful: &[String]) -> ActOutcome {
        let StopWords { key, verb, what } = self;
        let (what_is, n) = (("what", json!(what)), ("n", json!(count)));
        if doubtful.is_empty() {
            let obey = match count {
                1 => "1 agent obeys".to_owned(),
                count => format!("{} obey", plural(count, "agent")),
            };
            return fixed(true, key, &[what_is, n], format!("{verb} {what}: {obey}"));
        }
        let named = doubtful.iter().take(NAMED_MAX).cloned().collect::<Vec<_>>().join(", ");
        let more = doubtful.len().saturating_sub(NAMED_MAX);
        let more_named = if more > 0 { format!(" and {more} more") } else { String::new() };
        let sentence = format!("{verb} {what}; NOT CERTAIN of {named}{more_named}");
        let agents = if more > 0 { format!("{named}, +{more}") } else { named };
        fixed(false, &format!("{key}-unsure"), &[what_is, ("agents", json!(agents))], sentence)
    }
}

/// Returns that names of a stop are those of nothing; `is_rest_stopped` states whether the stop
/// concerns an agent nevertheless.
fn unknown_names(unknown: &[&String], is_rest_stopped: bool) -> String {
    let names: Vec<String> = unknown.iter().map(|name| format!("`{name}`")).collect();
    let (is, that_name) = match unknown {
        [_] => ("is no agent that is", "that name"),
        _ => ("are no agents that are", "these names"),
    };
    let stopped = if is_rest_stopped { "the others were stopped" } else { "nothing was stopped" };
    format!(
        "{} {is} present, and no place of the map: {stopped}; whatever comes by {that_name} is",
        names.join(", ")
    )
}

/// Returns a request for a goal, for which a right is checked.
fn any_goal() -> Request {
    let (goal, keep, partition) = (String::new(), Keep::default(), Default::default());
    Request::Achieve(Achieve { goal, keep, priority: 0, partition })
}

/// Returns the time limit of a goal.
fn limit(mode: GoalMode, within_ms: Option<u64>) -> Result<Option<Duration>, NotDone> {
    match (mode, within_ms.map(Duration::from_millis)) {
        (_, None) => Ok(None),
        (GoalMode::Keep, Some(_)) => {
            Err("a goal that is kept has no time limit; cancel it when it is not needed".to_owned())
        }
        (GoalMode::Reach, Some(limit)) if limit.is_zero() || limit > GOAL_LIMIT_MAX => {
            Err("the time limit of a goal is more than zero and at most a day".to_owned())
        }
        (GoalMode::Reach, limit) => Ok(limit),
    }
}

/// Returns the name of the action of a step.
fn action_of(step: &DryRunStep) -> String {
    let read = pddl::parse_step(&step.step).into_result();
    read.map(|step| step.action.to_string()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_nothing_are_told_whether_others_are_stopped_or_not() {
        let [hall, lab] = ["hal", "lap"].map(str::to_owned);
        let one = unknown_names(&[&hall], true);
        assert!(one.starts_with("`hal` is no agent that is present"), "{one}");
        assert!(one.contains("the others were stopped"), "{one}");
        let two = unknown_names(&[&hall, &lab], false);
        assert!(two.starts_with("`hal`, `lap` are no agents"), "{two}");
        assert!(two.contains("nothing was stopped"), "{two}");
    }

    #[test]
    fn a_limit_is_of_a_goal_that_is_reached_once() {
        assert_eq!(limit(GoalMode::Reach, Some(5_000)), Ok(Some(Duration::from_secs(5))));
        assert_eq!(limit(GoalMode::Keep, None), Ok(None));
        assert!(limit(GoalMode::Keep, Some(5_000)).is_err());
        assert!(limit(GoalMode::Reach, Some(0)).is_err());
        assert!(limit(GoalMode::Reach, Some(u64::MAX)).is_err());
    }
}
