//! The base's part of a robot's self-description: objects, predicates, facts, actions and methods, as
//! PDDL.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Methods};

use crate::{BasePlace, BaseReading, MobileBase, PowerSupply};

/// Time that the action of charging may take for docking, in addition to the charging itself.
const DOCKING: Duration = Duration::from_secs(60);

/// Cost of charging in a plan, in meters of driving, so that a plan charges the battery only if it
/// must.
const RECHARGE_COST: u32 = 10;

/// Cost of driving to the place beside which a base stands, in meters of driving.
const REJOIN_COST: u32 = 2;

impl MobileBase {
    /// Returns the PDDL objects of the base: the robot itself and its poses.
    pub fn objects(&self) -> String {
        let mut text = format!("{} - {}", self.id, self.kind);
        for (pose, ..) in &self.poses {
            push(&mut text, format_args!(" {pose} - pose"));
        }
        text
    }

    /// Returns the declarations of the predicates of the base that the ontology need not have, as
    /// PDDL.
    pub fn predicates(&self) -> &'static str {
        if self.ways.is_some() {
            "(stray-near ?b - mobile-base ?l - location) (lost ?b - mobile-base)
             (blocked ?b - mobile-base ?from ?to - location)"
        } else {
            ""
        }
    }

    /// Returns the declarations of the functions of the base that the ontology need not have, as
    /// PDDL.
    pub fn functions(&self) -> &'static str {
        if self.ways.is_some() { "(travel ?b - mobile-base ?from ?to - location)" } else { "" }
    }

    /// Returns the facts that the action model of the base states, as PDDL: those that never change,
    /// and what each way costs a real base.
    pub fn model_facts(&self) -> String {
        let costs = self.ways.as_ref().map(|ways| ways.costs(&self.id));
        self.constant_facts() + &costs.unwrap_or_default()
    }

    /// Returns the facts that never change. From `connected` the actuator takes the place beside a pose,
    /// for stops of that place.
    fn constant_facts(&self) -> String {
        let mut text = format!("(= (speed {}) {})", self.id, self.speed);
        for (pose, near, meters) in &self.poses {
            for (from, to) in [(pose, near), (near, pose)] {
                let way =
                    format_args!(" (connected {from} {to}) (= (distance {from} {to}) {meters})");
                push(&mut text, way);
            }
        }
        if let Some(PowerSupply { range, dock, .. }) = &self.power {
            let id = &self.id;
            push(&mut text, format_args!(" (dock-of {id} {dock}) (= (range {id}) {range})"));
        }
        text
    }

    /// Returns the facts of the base that are known at present, as PDDL; without the costs of ways,
    /// which are in the model alone.
    pub fn facts(&self) -> String {
        let BaseReading { place, charge } = self.current_state();
        let mut text = match place {
            BasePlace::At(place) => format!("(at {} {place}) ", self.id),
            BasePlace::Near(place) => format!("(stray-near {} {place}) ", self.id),
            BasePlace::Unknown | BasePlace::Unreachable => format!("(lost {}) ", self.id),
        };
        text += &self.constant_facts();
        if let Some(ways) = &self.ways {
            text += &ways.facts(&self.id);
        }
        if let (Some(PowerSupply { range, .. }), Some(charge)) = (&self.power, charge) {
            push(&mut text, format_args!(" (= (charge {}) {charge})", self.id));
            if charge >= *range {
                push(&mut text, format_args!(" (charged {})", self.id));
            }
        }
        text
    }

    /// Returns the PDDL of the actions that the base offers at present. `condition` is one more
    /// condition in the precondition of `move`, such as `(not (presenting ?b))`; `?b` is the robot.
    /// An empty text adds no condition.
    pub fn actions(&self, condition: &str) -> String {
        let kind = self.kind;
        if self.current_state().place == BasePlace::Unreachable {
            return String::new();
        }
        let (rejoin, passable, cost) = match &self.ways {
            Some(_) => (rejoin(kind), "(not (blocked ?b ?from ?to))", "(travel ?b ?from ?to)"),
            None => (String::new(), "", "(distance ?from ?to)"),
        };
        if self.power.is_none() {
            return format!(
                "{rejoin}(:action move
                    :agent ?b - {kind}
                    :parameters (?from ?to - location)
                    :precondition (and (at ?b ?from) (connected ?from ?to) {passable} {condition})
                    :effect (and (not (at ?b ?from)) (at ?b ?to)
                        (increase (total-cost) {cost})))"
            );
        }
        let recharge = format!(
            "{rejoin}(:action recharge
                :agent ?b - {kind}
                :parameters (?l - location)
                :precondition (and (at ?b ?l) (dock-of ?b ?l))
                :effect (and (charged ?b) (assign (charge ?b) (range ?b))
                    (increase (total-cost) {RECHARGE_COST})))"
        );
        if self.is_empty() {
            return recharge;
        }
        format!(
            "(:action move
                :agent ?b - {kind}
                :parameters (?from ?to - location)
                :precondition (and (at ?b ?from) (connected ?from ?to)
                    (>= (charge ?b) (distance ?from ?to)) {passable} {condition})
                :effect (and (not (at ?b ?from)) (at ?b ?to) (not (charged ?b))
                    (decrease (charge ?b) (distance ?from ?to))
                    (increase (total-cost) {cost})))
            {recharge}"
        )
    }

    /// Returns the methods that carry out the actions of the base.
    pub fn methods(&self) -> Methods {
        let navigate = Method {
            method: "navigate_to".to_owned(),
            arguments: [("place".to_owned(), "?to".to_owned())].into(),
            timeout: Millis(self.move_timeout),
        };
        let mut methods: Methods = [("move".to_owned(), navigate.clone())].into();
        if self.ways.is_some() {
            methods.insert("rejoin".to_owned(), navigate);
        }
        if let Some(PowerSupply { recharge_time, .. }) = &self.power {
            let recharge = Method {
                method: "recharge".to_owned(),
                arguments: BTreeMap::new(),
                timeout: Millis(*recharge_time * 2 + DOCKING),
            };
            methods.insert("recharge".to_owned(), recharge);
        }
        methods
    }
}

/// Returns the action by which a base that stands beside a place drives to the place, as PDDL.
fn rejoin(kind: &str) -> String {
    format!(
        "(:action rejoin
            :agent ?b - {kind}
            :parameters (?to - location)
            :precondition (stray-near ?b ?to)
            :effect (and (at ?b ?to) (not (stray-near ?b ?to))
                (increase (total-cost) {REJOIN_COST})))
        "
    )
}

fn push(text: &mut String, piece: std::fmt::Arguments<'_>) {
    text.write_fmt(piece).expect("invariant: writing to a String cannot fail");
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use actuator::{BoxFuture, PlaceName, model_of};
    use tokio::sync::watch;

    use super::*;
    use crate::{BaseDriver, DriveFailure};

    /// A driver of a base that never moves.
    struct ParkedDriver;

    impl BaseDriver for ParkedDriver {
        fn navigate_to(&self, _place: &str) -> BoxFuture<Result<(), DriveFailure>> {
            Box::pin(std::future::pending())
        }

        fn recharge(&self) -> BoxFuture<Result<(), String>> {
            Box::pin(std::future::pending())
        }

        fn read(&self) -> BoxFuture<Result<BaseReading, String>> {
            Box::pin(std::future::pending())
        }
    }

    /// The actuator finds the place beside a pose by this type and this predicate.
    #[test]
    fn a_pose_has_its_type_and_is_connected_with_the_place_beside_it() {
        let place = |name: &str| PlaceName::try_from(name.to_owned()).expect("a name");
        let reading = BaseReading { place: BasePlace::At("desk".to_owned()), charge: None };
        let base = MobileBase {
            id: "robot".to_owned(),
            kind: "courier",
            start: "desk".to_owned(),
            speed: 1.0,
            move_timeout: DOCKING,
            power: None,
            poses: vec![(place("desk"), place("office1"), 1.0)],
            state: Arc::new(watch::Sender::new(reading)),
            driver: Arc::new(ParkedDriver),
            ways: None,
            ros: None,
            wants_charge: false,
        };
        let (objects, facts) = (base.objects(), base.model_facts());
        let text =
            format!("(define (agent robot) (:domain d) (:objects {objects}) (:init {facts}))");
        let model = model_of(&text);
        let mut objects = model.objects.iter().map(|declaration| &declaration.object);
        let pose = objects.find(|object| object.name == "desk").expect("it is declared");
        assert_eq!(pose.ty.alternatives.len(), 1);
        assert_eq!(pose.ty.alternatives[0].as_str(), "pose");
        let facts: Vec<_> = model.init.iter().map(ToString::to_string).collect();
        assert!(facts.contains(&"(connected desk office1)".to_owned()), "{facts:?}");
        assert!(base.facts().contains("(at robot desk)"));
    }
}
