//! Requests that change the running ecosystem (docs/design.md, “Action models”): its state, its
//! plan metric, or its available actions. Observations are such requests as well.
//!
//! A request is either confirmed, or refused as a whole with the reason. A confirmation has remarks
//! about facts that do not apply at present, and about agents that contradict the request.

use acl::content::{
    ActionOf, ChangeActions, ChangeMetric, ChangeState, Observation, Outcome, Reason, Refusal,
    Report, Request,
};
use acl::{AgentId, Message, Performative};
use agent::domain_sync;
use agent::{Context, Participation};
use capability::{DomainChange, Effects, KnownFact, Owner};
use pddl::{Diagnostic, InitElement, Name, Severity, check_init_elements};

use crate::{AnnouncementScope, DomainMaintainer};

/// Result of an accepted request: the change of the domain, and the text of the answer.
type AcceptedChange = (DomainChange, String);

/// Function for the length of the way between two places.
const LENGTH: &str = "distance";

/// Maximum number of remarks in the answer to a request; further remarks are only counted.
const REMARKS_MAX: usize = 8;

impl DomainMaintainer {
    pub(crate) fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        domain_sync::compose(self, ctx);
        self.check_replicas(ctx);
        let participation = Participation::of(&message);
        let asker = &message.sender;
        let request = message.content_as::<Request>();
        let taken = match request {
            Ok(Request::ChangeState(change)) => self.change_state(asker, &change, ctx),
            Ok(Request::ChangeMetric(change)) => self.change_metric(&change),
            Ok(Request::ChangeActions(change)) => self.change_actions(change),
            Ok(Request::Observe(observed)) => self.observe(asker, &observed),
            Ok(Request::StoreRecords(handed)) => {
                return self.receive_handover(&message, &handed, ctx);
            }
            Ok(_) => Err(Refusal::new(
                Reason::Incapable,
                "a Domain Maintainer takes `change-state`, `change-metric`, `change-actions` and \
                 `observe`",
            )),
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        match taken {
            Ok((change, detail)) => {
                self.announcement_scope = self.announcement_scope.max(AnnouncementScope::Changes);
                domain_sync::report_change(self, &change, ctx);
                // A repeated request changes nothing here. In other agents it prolongs facts, or
                // makes them newer than those of another agent.
                if change.is_empty() {
                    self.announce_requests(ctx);
                }
                let report = Report::new(Outcome::Done, detail);
                ctx.answer(&participation, Performative::Confirm, &report);
            }
            Err(refusal) => ctx.answer(&participation, Performative::Refuse, &refusal),
        }
    }

    fn change_state(
        &mut self,
        asker: &AgentId,
        change: &ChangeState,
        ctx: &mut Context<Self>,
    ) -> Result<AcceptedChange, Refusal> {
        let effects = Effects::read(change).map_err(|mistakes| bad_content(&mistakes))?;
        if change.owner.is_none() {
            if let Some(problem) = effects.believe.iter().find_map(impossible_length) {
                return Err(Refusal::new(Reason::BadContent, problem));
            }
            self.check_against_domain(change, &effects)?;
        }
        let living = change.owner.as_ref().and_then(|owner| ctx.find(owner));
        let owner = Owner::Agent(change.owner.as_ref().unwrap_or(asker).clone());
        let notes = self.remarks(&effects.believe, &owner);
        let now = self.domain_sync.timestamp();
        let maintainer = &mut self.domain_sync.maintainer;
        let changed = match living {
            Some(owner) => {
                maintainer.apply_effects(&owner.agent, Some(owner.incarnation), &effects, now)
            }
            None => maintainer.apply_request(&owner, &effects, now),
        };
        let changed = changed.map_err(|declined| declined.refusal())?;
        let detail = if changed.is_empty() { "it was so already" } else { "believed" };
        Ok((changed, with_remarks(detail, notes)))
    }

    /// Checks the facts of a person's request against the present domain, and returns a refusal if
    /// a fact has an error. A fact with an undeclared predicate would be stored, but would never
    /// become visible. The facts of an agent are not checked, because they may arrive before the
    /// agent's declarations.
    fn check_against_domain(&self, change: &ChangeState, effects: &Effects) -> Result<(), Refusal> {
        let snapshot = self.domain_sync.maintainer.snapshot(self.domain_sync.timestamp());
        let texts = [(&change.believe, &effects.believe), (&change.retract, &effects.retract)];
        for (text, facts) in texts {
            let diagnostics = check_init_elements(&snapshot.domain, &snapshot.problem, facts);
            let mistake = diagnostics.iter().find(|found| found.severity == Severity::Error);
            if let Some(mistake) = mistake {
                return Err(Refusal::new(Reason::BadContent, mistake.located(text)));
            }
        }
        Ok(())
    }

    fn change_metric(&mut self, change: &ChangeMetric) -> Result<AcceptedChange, Refusal> {
        let read = |text: &String| pddl::parse_metric(text).into_result();
        let metric = change.metric.as_ref().map(read).transpose();
        let metric = metric.map_err(|mistakes| bad_content(&mistakes))?;
        let detail = match &metric {
            Some(metric) => format!("plans are measured by `{metric}` from now on"),
            None => "plans are measured as the map says again".to_owned(),
        };
        let now = self.domain_sync.timestamp();
        let changed = self.domain_sync.maintainer.set_metric(metric, now);
        let changed = changed.map_err(|declined| declined.refusal())?;
        if !self.has_base {
            self.early.note_metric();
        }
        Ok((changed, detail))
    }

    fn change_actions(&mut self, change: ChangeActions) -> Result<AcceptedChange, Refusal> {
        let ChangeActions { withhold, give_back } = change;
        if withhold.is_empty() && give_back.is_empty() {
            return Err(Refusal::new(Reason::BadContent, "it names no action to change"));
        }
        let of = |of: ActionOf| (Name::new(&of.action), of.agent);
        let withhold: Vec<_> = withhold.into_iter().map(of).collect();
        let give_back: Vec<_> = give_back.into_iter().map(of).collect();
        let now = self.domain_sync.timestamp();
        let changed = self.domain_sync.maintainer.change_actions(&withhold, &give_back, now);
        let changed = changed.map_err(|declined| declined.refusal())?;
        if !self.has_base {
            self.early.note_actions(&withhold, &give_back);
        }
        let parts = [("withheld", withhold), ("given back", give_back)];
        let parts = parts.into_iter().filter(|(_, of)| !of.is_empty()).map(|(what, of)| {
            let names: Vec<String> = of.iter().map(describe_action).collect();
            format!("{what}: {}", names.join(", "))
        });
        Ok((changed, parts.collect::<Vec<_>>().join("; ")))
    }

    fn observe(
        &mut self,
        asker: &AgentId,
        observed: &Observation,
    ) -> Result<AcceptedChange, Refusal> {
        let now = self.domain_sync.timestamp();
        let known = KnownFact::read(observed, now).map_err(|mistakes| bad_content(&mistakes))?;
        if known.is_empty() {
            return Err(Refusal::new(Reason::BadContent, "it states no fact"));
        }
        let facts: Vec<InitElement> = known.iter().map(|known| known.fact.clone()).collect();
        let notes = self.remarks(&facts, &Owner::Agent(asker.clone()));
        let changed = self.domain_sync.maintainer.apply_observation(asker, &known, now);
        Ok((changed.map_err(|declined| declined.refusal())?, with_remarks("believed", notes)))
    }

    /// Returns remarks about those of `facts` that do not apply at present, and about agents that
    /// contradict them.
    fn remarks(&self, facts: &[InitElement], speaker: &Owner) -> Vec<String> {
        let maintainer = &self.domain_sync.maintainer;
        let mut notes = Vec::new();
        for fact in facts {
            if let Some(misfit) = maintainer.misfit(fact) {
                notes.push(format!("`{fact}` does not count as long as {misfit}"));
            }
            for (owner, said) in maintainer.contradicting(fact, speaker) {
                let repeats = match &owner {
                    Owner::Agent(agent) => maintainer.incarnation(agent).is_some(),
                    Owner::Map => false,
                };
                notes.push(match repeats {
                    true => format!("{owner} says `{said}`, and its next heartbeat overrides this"),
                    false => format!("{owner} says `{said}`, and this counts instead"),
                });
            }
        }
        notes
    }
}

/// Returns the reason why a fact cannot be true if it gives the way between two places an
/// impossible length, as `althing check` does for the map; `None` if the fact is possible. A length
/// of 0 would make the way free in every plan, and the duration of a trip could not be computed.
fn impossible_length(fact: &InitElement) -> Option<String> {
    let InitElement::Assign(fluent, length) = fact else { return None };
    let [from, to] = &fluent.arguments[..] else { return None };
    let is_length = fluent.function == LENGTH && length.0 <= 0.0;
    is_length.then(|| {
        format!("the way from `{from}` to `{to}` cannot be {length} m long; write more than 0")
    })
}

fn bad_content(mistakes: &[Diagnostic]) -> Refusal {
    let lines: Vec<_> = mistakes.iter().map(ToString::to_string).collect();
    Refusal::new(Reason::BadContent, lines.join("; "))
}

fn with_remarks(detail: &str, mut notes: Vec<String>) -> String {
    let rest = notes.len().saturating_sub(REMARKS_MAX);
    notes.truncate(REMARKS_MAX);
    if rest > 0 {
        notes.push(format!("{rest} more remarks"));
    }
    std::iter::once(detail.to_owned()).chain(notes).collect::<Vec<_>>().join("; ")
}

fn describe_action((action, agent): &(Name, Option<AgentId>)) -> String {
    match agent {
        Some(agent) => format!("`{action}` of `{agent}`"),
        None => format!("`{action}` of all agents"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_length_of_a_way_must_be_positive() {
        let problem = |text: &str| {
            let facts = pddl::parse_init_elements(text).into_result().expect("a fact");
            impossible_length(&facts[0])
        };
        let why = "the way from `corridor` to `office1` cannot be 0 m long; write more than 0";
        assert_eq!(problem("(= (distance corridor office1) 0)").as_deref(), Some(why));
        assert!(problem("(= (distance corridor office1) -0.0)").is_some());
        assert!(problem("(= (distance corridor office1) -5)").is_some());
        assert_eq!(problem("(= (distance corridor office1) 0.1)"), None);
        assert_eq!(problem("(= (temperature office1) 0)"), None, "it may freeze");
        assert_eq!(problem("(= (free-distance office1) 0)"), None, "something is before it");
    }
}
