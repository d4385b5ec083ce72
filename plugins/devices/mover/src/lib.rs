//! The mover: a mobile base that carries tables, which takes two. The action is a joint one: both movers
//! offer it, agree to it, begin together, and stop together.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - Where tables stand is told by a tag reader.
//!
//! The mover has one driver, `simulated`.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{Method, Reason, Refusal};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use building::{BuildingHandle, DeviceError};
use mobile_base::{BaseConfig, BaseOutcome, MobileBase};
use serde::Deserialize;

/// The entry of the mover in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "mover",
    about: "a mobile base that carries tables, together with another one",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

const CARRY_TABLE: &str = "carry_table";

/// Time limit of carrying a table to the next place.
const CARRYING_MAX: Duration = Duration::from_secs(300);

/// The `config` of a mover's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

struct Mover {
    id: String,
    ontology: String,
    base: MobileBase,
    building: Arc<BuildingHandle>,
}

/// The result of a method of the mover.
enum MoverResult {
    Moved(BaseOutcome),
    /// A table was carried.
    Carried(TableErrand),
}

/// What a call of [`CARRY_TABLE`] is about.
struct TableErrand {
    other: String,
    table: String,
    to: String,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, unknown } = blueprint.config_as()?;
    if let Some(key) = unknown.keys().next() {
        return Err(blueprint.problem(format!("a mover's config has no key `{key}`")));
    }
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let mover = Mover {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        base: MobileBase::new(&blueprint, "mover", base)?,
        building,
    };
    Actuator::build(&blueprint, mover)
}

/// The PDDL of the action with a table.
const TABLE_ACTION: &str = "(:action carry-table
        :agent (?a - mover ?b - mover)
        :parameters (?t - table ?from ?to - location)
        :precondition (and (table-at ?t ?from) (at ?a ?from) (at ?b ?from) (connected ?from ?to))
        :effect (and (table-at ?t ?to) (not (table-at ?t ?from))
            (at ?a ?to) (not (at ?a ?from)) (at ?b ?to) (not (at ?b ?from))
            (increase (total-cost) (* 2 (distance ?from ?to)))))";

impl Mover {
    fn errand(&self, call: &MethodCall) -> Result<TableErrand, MethodFailure> {
        let argument = |name| call.argument(name).map(str::to_owned);
        let (one, other) = (argument("one")?, argument("other")?);
        let other = if one.eq_ignore_ascii_case(&self.id) { other } else { one };
        Ok(TableErrand { other, table: argument("table")?, to: argument("to")? })
    }

    fn carry_table(&self, call: &MethodCall) -> BoxFuture<Result<MoverResult, MethodFailure>> {
        let errand = self.errand(call);
        let (building, id) = (Arc::clone(&self.building), self.id.clone());
        let located = self.base.locate();
        Box::pin(async move {
            let errand = errand?;
            let TableErrand { other, table, to } = &errand;
            let carried = building.carry_table((&id, other), table, to).await;
            // The base has not driven by itself.
            located.await;
            match carried {
                Ok(()) => Ok(MoverResult::Carried(errand)),
                // This mover is able: the other one is to blame.
                Err(why @ (DeviceError::LetGo { .. } | DeviceError::LiftedAlone { .. })) => {
                    Err(MethodFailure::Hindered(why.to_string()))
                }
                Err(error) => Err(MethodFailure::Driver(error.to_string())),
            }
        })
    }
}

impl Device for Mover {
    type Yield = MoverResult;

    fn describe(&self) -> Description {
        let Mover { id, ontology, base, .. } = self;
        let mut methods = base.methods();
        let arguments =
            [("one", "?a"), ("other", "?b"), ("table", "?t"), ("from", "?from"), ("to", "?to")];
        let carry = Method::new(CARRY_TABLE, &arguments, CARRYING_MAX);
        methods.insert("carry-table".to_owned(), carry);
        let (objects, lasting, moving) = (base.objects(), base.model_facts(), base.actions(""));
        let (predicates, functions) = (base.predicates(), base.functions());
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types mover - mobile-base item - object table - item)
                (:functions {functions})
                (:predicates {predicates} (table-at ?t - table ?l - location))
                (:objects {objects})
                (:init {lasting})
                {moving}
                {TABLE_ACTION})"
        );
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of(&self.base.facts())
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        let from = call.argument("from").ok().filter(|_| call.method == CARRY_TABLE);
        let Some(from) = from else { return self.base.check_call(call) };
        if self.base.place().is_some_and(|place| place.eq_ignore_ascii_case(from)) {
            return None;
        }
        let whereabouts = self.base.whereabouts();
        let detail = format!("{} begins at `{from}`: the base stands {whereabouts}", call.action);
        Some(Refusal::new(Reason::Conflict, detail))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<MoverResult, MethodFailure>> {
        if call.method == CARRY_TABLE {
            return self.carry_table(call);
        }
        let moved = self.base.perform(call);
        Box::pin(async move { moved.await.map(MoverResult::Moved) })
    }

    fn on_success(&mut self, _call: &MethodCall, done: MoverResult) -> MethodResult {
        match done {
            MoverResult::Moved(moved) => self.base.performed(&moved),
            MoverResult::Carried(TableErrand { other, table, to }) => {
                let detail = format!("has carried {table} to {to} with {other}");
                MethodResult { detail, observations: Vec::new() }
            }
        }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        Some(self.base.locate())
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Mover>>> {
        let wish = self.base.next_initiative();
        Some(Box::pin(async move {
            wish.await;
            let news: DeviceEvent<Mover> = Box::new(|robot| robot.base.take_initiatives());
            news
        }))
    }
}
