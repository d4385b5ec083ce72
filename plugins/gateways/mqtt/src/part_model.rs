//! Builds the action model of a part of a device: its objects, its lasting facts and its actions,
//! with the types, predicates and functions that the shared ontology lacks.
//!
//! A level that is set is an object with a number, because actions have no numeric parameters.
//! `raise-LEVEL` and `lower-LEVEL` cost more for a greater change, so that a plan for `(>= LEVEL
//! 50)` sets 50 and not 100. `set-LEVEL` is for a level that is unknown, and for a lamp that is
//! off.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use actuator::{OnOffPredicates, is_derived};
use pddl::Domain;

use crate::device_class::ClassKind;
use crate::level::weight;
use crate::option::SettableOption;
use crate::part::{ClassifiedFeature, DevicePart, leads};

/// Name of the class with the modes of a thermostat.
const MODES: &str = "thermostat_mode";

/// Modes in which a thermostat heats or cools a room to its set point, by the names in Home
/// Assistant and Zigbee2MQTT.
const HEATING: &[&str] = &["auto", "emergency_heating", "heat", "heat_cool"];
const COOLING: &[&str] = &["auto", "cool", "heat_cool", "precooling"];

/// Costs of the actions that change a level. A change that raises costs 1 and the weight of the
/// level, one that lowers costs 2 less this weight. Setting a level in any state costs more than
/// most changes, but less than switching a lamp on and then dimming it.
const RAISING: &str = "(+ 1 (weight ?l))";
const LOWERING: &str = "(- 2 (weight ?l))";
const SETTING: &str = "(+ 1.98 (* 0.01 (weight ?l)))";

/// Costs of heating and of cooling: to wait for a temperature takes longer than any switch.
const HEATING_UP: &str = "(+ 5 (weight ?l))";
const COOLING_DOWN: &str = "(- 6 (weight ?l))";

impl DevicePart {
    /// Returns the action model of the agent. `offers` returns for each feature whether its actions
    /// can be used at present.
    pub(crate) fn model(&self, ontology: &Domain, offers: impl Fn(usize) -> bool) -> String {
        let mut draft = ModelDraft::of(self, ontology);
        for number in (0..self.features.len()).filter(|number| leads(&self.features, *number)) {
            draft.describe(number, offers(number));
        }
        draft.text()
    }

    /// Returns the type of the agent in PDDL.
    fn kind(&self) -> &str {
        self.features.first().map_or("sensor", |known| known.class.agent.as_str())
    }

    fn is_thing(&self) -> bool {
        let is_thing =
            |known: &ClassifiedFeature| known.class.kind().is_some_and(|kind| kind.is_thing());
        self.features.iter().any(is_thing)
    }

    /// Returns the predicate for the room of the device.
    fn stands(&self) -> &'static str {
        if self.is_thing() { "installed" } else { "located" }
    }

    /// Returns the PDDL term for the switch of the thing; `None` if it has none.
    fn own_switch(&self, ontology: &Domain) -> Option<String> {
        let is_switch = |known: &&ClassifiedFeature| {
            matches!(known.class.kind(), Some(ClassKind::Switch { .. }))
        };
        let switch = self.features.iter().find(is_switch)?;
        Some(switch.term("?d", "?r", ontology))
    }

    /// Returns the modes of a thermostat; `None` if it has none.
    fn modes(&self) -> Option<&ClassifiedFeature> {
        self.features.iter().find(|known| known.name == MODES)
    }

    /// Returns the ways in which the setting `number` brings the measured number of the room to a
    /// level. A thermostat without modes heats, unless its set point is for cooling. A thermostat
    /// with two set points cools by the one for cooling.
    fn ways(&self, number: usize) -> Vec<ReachingAction<'_>> {
        let Some(reached) = self.features[number].class.reached() else { return Vec::new() };
        if self.reached_by(number).is_none() {
            return Vec::new();
        }
        let has_other = self.features.iter().any(|known| {
            known.class.reached().is_some_and(|other| other.up.is_none() && other.down.is_some())
        });
        let can = |is_up: bool| match self.modes() {
            Some(modes) => fitting_modes(modes, is_up).next().is_some(),
            None => is_up || reached.up.is_none(),
        };
        let up =
            reached.up.filter(|_| can(true)).map(|action| ReachingAction { action, is_up: true });
        let down = reached.down.filter(|_| can(false) && !(has_other && reached.up.is_some()));
        let down = down.map(|action| ReachingAction { action, is_up: false });
        up.into_iter().chain(down).collect()
    }

    /// Returns the location of the device, as PDDL facts.
    pub(crate) fn place(&self, ontology: &Domain) -> String {
        let DevicePart { agent, room, features, .. } = self;
        let mut place = format!("({} {agent} {room})", self.stands());
        let leading = features.iter().enumerate().filter(|(number, _)| leads(features, *number));
        for (_, known) in leading {
            if let Some(ClassKind::YesOrNo { yes, own: Some((_, at)), .. }) = known.class.kind()
                && is_derived(ontology, yes)
            {
                let _ = write!(place, " ({at} {agent} {room})");
            }
        }
        place
    }
}

/// An action that brings a measured number of the room up or down to a level.
struct ReachingAction<'p> {
    action: &'p str,
    is_up: bool,
}

/// Returns the modes in which a thermostat heats (`is_up`) or cools.
fn fitting_modes(modes: &ClassifiedFeature, is_up: bool) -> impl Iterator<Item = &SettableOption> {
    let names = if is_up { HEATING } else { COOLING };
    modes.options().iter().filter(move |option| names.contains(&option.text.as_str()))
}

/// The parts of an action model, while it is being written.
struct ModelDraft<'p> {
    part: &'p DevicePart,
    ontology: &'p Domain,
    declared: BTreeSet<String>,
    types: String,
    predicates: String,
    functions: String,
    axioms: String,
    objects: String,
    init: String,
    actions: String,
}

impl<'p> ModelDraft<'p> {
    fn of(part: &'p DevicePart, ontology: &'p Domain) -> ModelDraft<'p> {
        let mut draft = ModelDraft {
            part,
            ontology,
            declared: BTreeSet::new(),
            types: String::new(),
            predicates: String::new(),
            functions: String::new(),
            axioms: String::new(),
            objects: format!("{} - {} ", part.agent, part.kind()),
            init: part.place(ontology),
            actions: String::new(),
        };
        draft.declare_type(part.kind(), if part.is_thing() { "" } else { "sensor" });
        draft
    }

    fn text(self) -> String {
        let ModelDraft { part, ontology, types, functions, axioms, objects, init, .. } = self;
        let installed = match part.is_thing() {
            // A lamp and a lock get the same declaration, so that one ecosystem can have both.
            true => "(installed ?d - object ?r - room)",
            false => "",
        };
        let section = |name: &str, body: String| match body.trim() {
            "" => String::new(),
            body => format!("(:{name} {body})"),
        };
        format!(
            "(define (agent {}) (:domain {}) {} {} {} {axioms}
               (:objects {objects}) (:init {init}) {})",
            part.agent,
            ontology.name,
            section("types", types),
            section("predicates", self.predicates + installed),
            section("functions", functions),
            self.actions,
        )
    }

    // === declarations ===

    fn declare_type(&mut self, name: &str, parent: &str) {
        let is_there = |wanted: &str| self.ontology.types.iter().any(|one| one.name == wanted);
        let is_known = is_there(name) || !self.declared.insert(format!("type {name}"));
        if !is_known {
            let is_parent = is_there(parent) || self.declared.contains(&format!("type {parent}"));
            let parent = if is_parent { parent } else { "object" };
            let _ = write!(self.types, "{name} - {parent} ");
        }
    }

    fn declare_predicate(&mut self, name: &str, parameters: &str) {
        let is_there = self.ontology.predicates.iter().any(|one| one.name == name);
        if !is_there && self.declared.insert(format!("predicate {name}")) {
            let _ = write!(self.predicates, "({name} {parameters}) ");
        }
    }

    fn declare_function(&mut self, name: &str, parameters: &str) {
        let is_there = self.ontology.functions.iter().any(|one| one.name == name);
        if !is_there && self.declared.insert(format!("function {name}")) {
            let _ = write!(self.functions, "({name} {parameters}) ");
        }
    }

    fn declare_object(&mut self, name: &str, kind: &str) -> bool {
        let is_new = self.declared.insert(format!("object {name}"));
        if is_new {
            let _ = write!(self.objects, "{name} - {kind} ");
        }
        is_new
    }

    // === actions ===

    /// Adds an action of the device. `more` are further parameters and their conditions.
    fn action(&mut self, name: &str, more: (&str, &str), effect: &str, cost: &str) {
        self.observing_action(name, more, effect, (cost, ""));
    }

    fn observing_action(
        &mut self,
        name: &str,
        (parameters, condition): (&str, &str),
        effect: &str,
        (cost, observed): (&str, &str),
    ) {
        let (kind, stands) = (self.part.kind(), self.part.stands());
        let _ = write!(
            self.actions,
            "(:action {name} :agent ?d - {kind} :parameters (?r - room {parameters})
               :precondition (and ({stands} ?d ?r) {condition})
               :effect (and {effect} (increase (total-cost) {cost})) {observed})"
        );
    }

    /// Adds the declarations of a feature, and its actions if `offers` is `true`.
    fn describe(&mut self, number: usize, offers: bool) {
        let known = &self.part.features[number];
        let before = self.actions.len();
        let term = known.term("?d", "?r", self.ontology);
        match known.class.kind() {
            Some(ClassKind::Number { action, known: is_known, value, of_device, .. }) => {
                let (subject, parameter) =
                    if of_device { ("?d", "?d - object") } else { ("?r", "?r - room") };
                self.declare_predicate(is_known, parameter);
                self.declare_function(value, parameter);
                self.measuring(action, &format!("({is_known} {subject})"), &term);
            }
            Some(ClassKind::YesOrNo { action, known: is_known, yes, .. }) => {
                self.declare_predicate(is_known, "?r - room");
                self.declare_predicate(yes, "?r - room");
                self.measuring(action, &format!("({is_known} ?r)"), &term);
            }
            Some(ClassKind::Switch { words, on, off }) => {
                self.switching(number, words, (on, off), &term);
            }
            Some(ClassKind::Level { level, unit, options }) => {
                self.declare_levels(number, level, unit, options);
                self.setting_level(number, level, options);
                self.reaching(number, level, options);
            }
            Some(ClassKind::Choice { choice, options }) => {
                self.choosing(number, choice, options);
            }
            Some(ClassKind::Press { press, options }) => {
                self.declare_options(number, options);
                self.declare_predicate(press, &format!("?d - object ?o - {options}"));
            }
            Some(ClassKind::Trigger { trigger, action }) => {
                self.declare_predicate(trigger, "?d - object");
                self.action(action, ("", ""), &term, "1");
            }
            None => (),
        }
        if !offers {
            self.actions.truncate(before);
        }
    }

    fn measuring(&mut self, action: &str, effect: &str, term: &str) {
        let observed = format!(":observe {term}");
        self.observing_action(action, ("", ""), effect, ("1", &observed));
    }

    fn switching(
        &mut self,
        number: usize,
        words: OnOffPredicates<'_>,
        (on, off): (&str, &str),
        term: &str,
    ) {
        self.predicates += &words.predicates(self.ontology);
        self.axioms += &words.axiom(self.ontology);
        let part = self.part;
        let level = part.level_of(number).map(|level| &part.features[level]);
        let Some((known, levels)) = level.and_then(|known| Some((known, known.levels()?))) else {
            self.action(on, ("", ""), term, "1");
            return self.action(off, ("", ""), &format!("(not {term})"), "1");
        };
        let level = known.term("?d", "?r", self.ontology);
        // To switch off is the greatest change of a level.
        let nothing = format!("(not {term}) (assign {level} 0)");
        self.action(off, ("", ""), &nothing, "2");
        if known.class.remembers {
            let last = known.remembered_term("?d");
            let name = known.remembered_name();
            self.declare_function(&name, "?d - object");
            self.action(on, ("", ""), &format!("{term} (assign {level} {last})"), "1");
        } else {
            let most = levels.levels.last().map_or(100.0, |level| level.amount);
            self.action(on, ("", ""), &format!("{term} (assign {level} {most})"), "2");
        }
    }

    fn declare_levels(&mut self, number: usize, level: &str, unit: &str, options: &str) {
        let known = &self.part.features[number];
        self.declare_type("level", "");
        self.declare_type(options, "level");
        self.declare_function("amount", "?l - level");
        self.declare_function("weight", "?l - level");
        self.declare_function(level, "?d - object");
        self.declare_predicate(&format!("allows-{level}"), &format!("?d - object ?l - {options}"));
        // A thing with a switch is at the level 0 when it is off: its switch is used for that.
        let is_switched = self.part.switch_of(number).is_some();
        let levels = known.levels().map(|levels| levels.levels.as_slice()).unwrap_or_default();
        for one in levels.iter().filter(|one| one.amount > 0.0 || !is_switched) {
            let name = &one.name;
            if self.declare_object(name, options) {
                let (amount, weight) = (one.amount, weight(one.amount, unit));
                let _ = write!(self.init, " (= (amount {name}) {amount})");
                let _ = write!(self.init, " (= (weight {name}) {weight})");
            }
            let _ = write!(self.init, " (allows-{level} {} {name})", self.part.agent);
        }
    }

    fn setting_level(&mut self, number: usize, level: &str, options: &str) {
        let known = &self.part.features[number];
        let switch = self.part.switch_of(number).filter(|_| known.class.remembers);
        let is_on = switch.map(|switch| self.part.features[switch].term("?d", "?r", self.ontology));
        let is_on = is_on.unwrap_or_default();
        let parameters = format!("?l - {options}");
        let allowed = format!("(allows-{level} ?d ?l)");
        // The message for a color temperature switches some lamps on.
        let switches_on = known.levels().is_some_and(|levels| levels.switches_on);
        let goes_on = match switches_on && switch.is_none() {
            true => self.part.own_switch(self.ontology).unwrap_or_default(),
            false => String::new(),
        };
        let effect = format!("(assign ({level} ?d) (amount ?l)) {goes_on}");
        for (verb, sign, cost) in [("raise", "<", RAISING), ("lower", ">", LOWERING)] {
            let condition = format!("{allowed} {is_on} ({sign} ({level} ?d) (amount ?l))");
            self.action(&format!("{verb}-{level}"), (&parameters, &condition), &effect, cost);
        }
        let effect = format!("{effect} {is_on}");
        self.action(&format!("set-{level}"), (&parameters, &allowed), &effect, SETTING);
    }

    /// Adds the actions that bring a measured number of the room to a level.
    fn reaching(&mut self, number: usize, level: &str, options: &str) {
        let part = self.part;
        let Some(observed) = part.reached_by(number) else { return };
        let measured = part.features[observed].term("?d", "?r", self.ontology);
        for ReachingAction { action, is_up } in part.ways(number) {
            let (sign, cost) = if is_up { ("<", HEATING_UP) } else { (">", COOLING_DOWN) };
            let mode = self.mode_for(action, is_up);
            let condition =
                format!("(allows-{level} ?d ?l) ({sign} {measured} (amount ?l)) {mode}");
            let effect =
                format!("(assign ({level} ?d) (amount ?l)) (assign {measured} (amount ?l))");
            self.action(action, (&format!("?l - {options}"), &condition), &effect, cost);
        }
    }

    /// Returns the condition that the device is in a mode in which it can do `action`. The
    /// condition is empty if the device has no modes.
    fn mode_for(&mut self, action: &str, is_up: bool) -> String {
        let part = self.part;
        let Some(modes) = part.modes() else { return String::new() };
        let Some(ClassKind::Choice { choice, options }) = modes.class.kind() else {
            return String::new();
        };
        self.declare_type(options, "");
        self.declare_predicate(&format!("{action}-in"), &format!("?d - object ?o - {options}"));
        for option in fitting_modes(modes, is_up) {
            let _ = write!(self.init, " ({action}-in {} {})", part.agent, option.name);
        }
        format!("(exists (?o - {options}) (and ({choice} ?d ?o) ({action}-in ?d ?o)))")
    }

    fn declare_options(&mut self, number: usize, options: &str) {
        self.declare_type(options, "");
        for option in self.part.features[number].options() {
            self.declare_object(&option.name, options);
        }
    }

    fn choosing(&mut self, number: usize, choice: &str, options: &str) {
        self.declare_options(number, options);
        let parameters = format!("?d - object ?o - {options}");
        self.declare_predicate(choice, &parameters);
        self.declare_predicate(&format!("offers-{choice}"), &parameters);
        for option in self.part.features[number].options() {
            let _ = write!(self.init, " (offers-{choice} {} {})", self.part.agent, option.name);
        }
        // A lamp that gets a color is switched on, too; to switch it on alone changes less.
        let switch = self
            .part
            .switch_of(number)
            .map(|switch| self.part.features[switch].term("?d", "?r", self.ontology));
        let cost = if switch.is_some() { "2" } else { "1" };
        let effect = format!(
            "(forall (?x - {options}) (not ({choice} ?d ?x))) ({choice} ?d ?o) {}",
            switch.unwrap_or_default()
        );
        let more = (format!("?o - {options}"), format!("(offers-{choice} ?d ?o)"));
        self.action(&format!("set-{choice}"), (&more.0, &more.1), &effect, cost);
    }
}

impl ClassifiedFeature {
    /// Returns the PDDL term for the feature's value: a function or a predicate, of the device or
    /// of its room. The term for a choice and for a press has no option.
    pub(crate) fn term(&self, device: &str, room: &str, ontology: &Domain) -> String {
        match self.class.kind() {
            Some(ClassKind::Number { value, of_device, .. }) => {
                format!("({value} {})", if of_device { device } else { room })
            }
            Some(ClassKind::YesOrNo { yes, own: Some((own, _)), .. })
                if is_derived(ontology, yes) =>
            {
                format!("({own} {device})")
            }
            Some(ClassKind::YesOrNo { yes, .. }) => format!("({yes} {room})"),
            Some(ClassKind::Switch { words, .. }) => words.term(device, room, ontology),
            Some(ClassKind::Level { level, .. }) => format!("({level} {device})"),
            Some(ClassKind::Choice { choice, .. }) => format!("({choice} {device})"),
            Some(ClassKind::Press { press, .. }) => format!("({press} {device})"),
            Some(ClassKind::Trigger { trigger, .. }) => format!("({trigger} {device})"),
            None => String::new(),
        }
    }

    /// Returns the name of the function with the level that the thing remembers while it is off.
    fn remembered_name(&self) -> String {
        match self.class.kind() {
            Some(ClassKind::Level { level, .. }) => format!("last-{level}"),
            _ => String::new(),
        }
    }

    /// Returns the PDDL term for the level that the thing remembers while it is off.
    pub(crate) fn remembered_term(&self, device: &str) -> String {
        format!("({} {device})", self.remembered_name())
    }
}

impl DevicePart {
    /// Returns the actions of a feature, each with the method that performs it.
    pub(crate) fn methods(&self, number: usize) -> Vec<ActionMethod> {
        let Some(known) = self.features.get(number) else { return Vec::new() };
        let name = &known.name;
        let method = |action: &str, method: String, arguments: &[(&'static str, &'static str)]| {
            ActionMethod { action: action.to_owned(), method, arguments: arguments.to_vec() }
        };
        match known.class.kind() {
            Some(ClassKind::Number { action, .. } | ClassKind::YesOrNo { action, .. }) => {
                vec![method(action, format!("{READ}{name}"), &[])]
            }
            Some(ClassKind::Switch { on, off, .. }) => {
                vec![method(on, ON.to_owned(), &[]), method(off, OFF.to_owned(), &[])]
            }
            Some(ClassKind::Level { level, .. }) => {
                let to = [(LEVEL, "?l")];
                let verbs = ["raise", "lower", "set"].map(|verb| format!("{verb}-{level}"));
                let set = |action: String| method(&action, format!("{SET}{name}"), &to);
                let bring = |way: ReachingAction<'_>| {
                    let verb = if way.is_up { UP } else { DOWN };
                    method(way.action, format!("{verb}{name}"), &to)
                };
                let ways = self.ways(number).into_iter().map(bring);
                verbs.into_iter().map(set).chain(ways).collect()
            }
            Some(ClassKind::Choice { choice, .. }) => {
                let option = [(OPTION, "?o")];
                vec![method(&format!("set-{choice}"), format!("{CHOOSE}{name}"), &option)]
            }
            Some(ClassKind::Trigger { action, .. }) => {
                vec![method(action, format!("{TRIGGER}{name}"), &[])]
            }
            Some(ClassKind::Press { .. }) | None => Vec::new(),
        }
    }
}

/// Names of the methods that switch on and off.
pub(crate) const ON: &str = "on";
pub(crate) const OFF: &str = "off";

/// Beginnings of the names of methods; the name of the feature's class follows.
pub(crate) const READ: &str = "read-";
pub(crate) const SET: &str = "set-";
pub(crate) const UP: &str = "bring-up-";
pub(crate) const DOWN: &str = "bring-down-";
pub(crate) const CHOOSE: &str = "choose-";
pub(crate) const TRIGGER: &str = "trigger-";

/// Names of the arguments of methods.
pub(crate) const LEVEL: &str = "level";
pub(crate) const OPTION: &str = "option";

/// An action of a feature, and the method that performs it.
pub(crate) struct ActionMethod {
    pub(crate) action: String,
    pub(crate) method: String,
    /// Arguments of the method, each with the parameter of the action.
    pub(crate) arguments: Vec<(&'static str, &'static str)>,
}
