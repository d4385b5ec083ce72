//! The Domain Maintainer (the paper, “Domain Maintainer”): what the ecosystem can do now, and
//! what is known.
//!
//! - Hears action models and heartbeats, sees who comes and goes; composes (`capability`).
//! - Tells all what changed (`inform`), answers who asks for the domain or the state.
//! - Takes changes of the state by `request`.
//! - Does not plan, and decides nothing about goals.

use std::time::Duration;

use acl::content::{
    BelievedFact, BelievedState, ChangeState, EpochChange, Inform, Outcome, Reason, Refusal,
    Report, Request,
};
use acl::{AgentId, Deadline, Message, Performative};
use agent::upkeep::{self, Maintains, Upkeep};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, Engagement, Launch, PluginEntry, Presence,
    Resource, TimerId,
};
use capability::{Change, Conflict, Effects, Maintainer, Owner, Scope};
use pddl::{Severity, check_init_elements};

/// How long changes are gathered before they are announced: the models of a daemon that starts
/// come within this time, and one announcement serves them all.
const GATHERING: Duration = Duration::from_millis(5);

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "domain-maintainer",
    about: "composes what everyone can do, and keeps what is known",
    drivers: &[],
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let (ontology, map) = (&blueprint.host.ontology, &blueprint.host.map);
    let maintainer = Maintainer::new((**ontology).clone(), (**map).clone(), Scope::Everything);
    Ok(Box::new(DomainMaintainer {
        upkeep: Upkeep::new(maintainer),
        unannounced: None,
        announcing: None,
    }))
}

struct DomainMaintainer {
    upkeep: Upkeep,
    /// What changed since the last announcement.
    unannounced: Option<EpochChange>,
    announcing: Option<TimerId>,
}

impl Agent for DomainMaintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on_broadcast(Performative::Inform, Self::informed)
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        upkeep::presence(self, presence, ctx);
    }

    fn asked(&mut self, resource: Resource, _ctx: &mut Context<Self>) -> Option<String> {
        let answer = match resource {
            Resource::Domain => {
                let snapshot = self.upkeep.maintainer.snapshot(self.upkeep.moment());
                serde_json::to_string(&snapshot.to_content())
            }
            Resource::State => serde_json::to_string(&self.state()),
            Resource::Directory
            | Resource::Goals
            | Resource::Model
            | Resource::Mailbox
            | Resource::Questions => return None,
        };
        answer.ok()
    }
}

impl Maintains for DomainMaintainer {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    /// Gathers what changed, to announce it in one message.
    fn changed(&mut self, change: &Change, ctx: &mut Context<Self>) {
        if change.epoch_changed {
            tracing::info!(epoch = change.epoch, joined = ?change.joined, left = ?change.left,
                "a new epoch");
        }
        let change = EpochChange::from(change);
        match &mut self.unannounced {
            None => self.unannounced = Some(change),
            Some(gathered) => gather(gathered, change),
        }
        if self.announcing.is_none() {
            let announce =
                |maintainer: &mut Self, ctx: &mut Context<Self>| maintainer.announce(ctx);
            self.announcing = Some(ctx.after(GATHERING, announce));
        }
    }

    fn conflicted(&mut self, conflicts: &[Conflict], ctx: &mut Context<Self>) {
        for conflict in conflicts {
            tracing::warn!(agents = ?conflict.agents, "{conflict}");
            for agent in &conflict.agents {
                ctx.tell(
                    agent,
                    Performative::Refuse,
                    &Refusal::new(Reason::Conflict, conflict.to_string()),
                );
            }
        }
    }
}

impl DomainMaintainer {
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        upkeep::informed(self, &message, ctx);
    }

    fn announce(&mut self, ctx: &mut Context<Self>) {
        self.announcing = None;
        if let Some(change) = self.unannounced.take() {
            ctx.inform_all(&Inform::Epoch(change));
        }
    }

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let engagement = Engagement::of(&message);
        let change = match message.content_as::<Request>() {
            Ok(Request::ChangeState(change)) => change,
            Ok(_) => {
                let detail = "a Domain Maintainer changes the state; it takes `change-state`";
                return ctx.refuse(&engagement, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        match self.change_state(&message.sender, &change, ctx) {
            Ok(detail) => {
                let report = Report::new(Outcome::Done, detail);
                ctx.answer(&engagement, Performative::Confirm, &report);
            }
            Err(refusal) => ctx.answer(&engagement, Performative::Refuse, &refusal),
        }
    }

    fn change_state(
        &mut self,
        asker: &AgentId,
        change: &ChangeState,
        ctx: &mut Context<Self>,
    ) -> Result<&'static str, Refusal> {
        let effects = Effects::read(change).map_err(|diagnostics| {
            let lines: Vec<_> = diagnostics.iter().map(ToString::to_string).collect();
            Refusal::new(Reason::BadContent, lines.join("; "))
        })?;
        if change.owner.is_none() {
            self.check(change, &effects)?;
        }
        let now = self.upkeep.moment();
        let living = change.owner.as_ref().and_then(|owner| ctx.find(owner));
        let change = match living {
            Some(owner) => {
                let (agent, life) = (&owner.agent, owner.incarnation);
                self.upkeep.maintainer.confirm(agent, Some(life), &effects, now)
            }
            None => {
                let owner = Owner::Agent(change.owner.as_ref().unwrap_or(asker).clone());
                self.upkeep.maintainer.set(&owner, &effects, now)
            }
        };
        let change = change.map_err(|declined| declined.refusal())?;
        upkeep::conclude(self, &change, ctx);
        Ok(if change.is_empty() { "so it was already" } else { "believed" })
    }

    /// Whether a person's facts can be believed: what nobody here has a word for would be kept
    /// and never seen again. An agent's may come before its words do.
    fn check(&self, change: &ChangeState, effects: &Effects) -> Result<(), Refusal> {
        let snapshot = self.upkeep.maintainer.snapshot(self.upkeep.moment());
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

    fn state(&self) -> BelievedState {
        let maintainer = &self.upkeep.maintainer;
        let provenance = maintainer.provenance(self.upkeep.moment());
        let facts = provenance
            .into_iter()
            .filter(|fact| fact.left_out.is_none())
            .map(|fact| BelievedFact {
                fact: fact.fact.to_string(),
                owners: fact.claims.iter().map(|claim| claim.owner.to_string()).collect(),
                age_ms: fact
                    .claims
                    .iter()
                    .map(|claim| u64::try_from(claim.age.as_millis()).unwrap_or(u64::MAX))
                    .min()
                    .unwrap_or(0),
                known_for: known_for(&fact.claims),
            })
            .collect();
        BelievedState { epoch: maintainer.epoch(), revision: maintainer.revision(), facts }
    }
}

/// A fact is known as long as the longest claim; until further notice, if any claim is so.
fn known_for(claims: &[capability::ClaimedBy]) -> Option<Deadline> {
    let left: Option<Vec<Duration>> = claims.iter().map(|claim| claim.left).collect();
    left?.into_iter().max().map(Deadline)
}

fn gather(gathered: &mut EpochChange, change: EpochChange) {
    let EpochChange { epoch, revision, joined, left, believed, retracted } = change;
    (gathered.epoch, gathered.revision) = (epoch, revision);
    gathered.joined.retain(|agent| !left.contains(agent));
    gathered.left.retain(|agent| !joined.contains(agent));
    gathered.joined.extend(joined);
    gathered.left.extend(left);
    for (all, more) in [(&mut gathered.believed, believed), (&mut gathered.retracted, retracted)] {
        if !all.is_empty() && !more.is_empty() {
            all.push('\n');
        }
        all.push_str(&more);
    }
}
