//! Export of an agent's action model: the part that the rules export to another ecosystem becomes
//! the model of the proxy agent.
//!
//! All functions are pure: the same model, vocabulary and ontologies give the same result.
//! Therefore `althing check` and the running daemon leave out the same parts of a model for the
//! same reasons.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::time::Duration;

use acl::content::Methods;
use pddl::{
    ActionModel, ActionSchema, Assign, Assignment, Atom, Condition, Domain, Effect, Expression,
    FluentTerm, FunctionDeclaration, InitElement, Name, Number, ObjectDeclaration,
    PredicateDeclaration, Privacy, Problem, Span, TOTAL_COST, Term, TypeExpr, Typed,
};

use super::translate::{Translator, Untranslatable};
use super::vocabulary::{AgentMapping, InterfaceVocabulary};

/// Ontologies and maps of the two ecosystems of an interface, as the ecosystem files contain them.
/// An agent runs on the far side; its proxy agent runs on the near side.
#[derive(Clone, Copy)]
pub struct EcosystemFiles<'s> {
    /// Ontology and map of the far side, where the agent runs.
    pub far: (&'s Domain, &'s Problem),
    /// Ontology and map of the near side, where the proxy agent runs.
    pub near: (&'s Domain, &'s Problem),
}

/// Model of a proxy agent, and what was left out of the original model.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportedModel {
    /// Action model of the proxy agent, in the vocabulary of the near side.
    pub model: ActionModel,
    /// Facts that hold whatever the agent announces: the exported facts of the far map, and one
    /// fact for each exported object, which allows actions to use the object.
    pub constant_facts: Vec<InitElement>,
    /// Time limit of each action of the proxy agent, by near name: the time limit of the real
    /// agent's method. Zero if the real agent declares no method for the action.
    pub timeouts: BTreeMap<String, Duration>,
    /// Actions that a rule names and that cannot be exported.
    pub excluded: Vec<ExcludedAction>,
}

/// An action that a rule names and that cannot be exported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExcludedAction {
    /// Name of the action on the far side, where the agent runs.
    pub action: String,
    /// Name of the action on the near side, as the rule gives it.
    pub near: String,
    /// The reason why the action cannot be exported.
    pub why: ExportError,
}

/// Reason why an action is not exported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExportError {
    /// The agent does not offer the action.
    NotOffered,
    /// A condition of the action cannot be translated.
    Condition(Untranslatable),
    /// The exported type of a parameter would admit objects that the original action does not
    /// accept.
    Parameter(Name, Untranslatable),
    /// An effect of the action cannot be translated exactly.
    Effect(Untranslatable),
    /// The cost of the action cannot be translated.
    Cost(Untranslatable),
    /// No effect of the action is exported.
    NoEffect,
    /// The action is durative; durative actions are never exported.
    Durative,
    /// Several agents act in the action; such actions are never exported.
    Joint,
}

/// Returns the part of `model` that the rules export, in the vocabulary of the near side. `model`
/// is the action model of the agent on the far side.
///
/// # Errors
///
/// Returns an error if none of the agent's types is exported.
pub fn export(
    vocabulary: &InterfaceVocabulary,
    mapping: &AgentMapping,
    endpoints: EcosystemFiles<'_>,
    model: &ActionModel,
    methods: &Methods,
) -> Result<ExportedModel, String> {
    let translator = Translator::of_model(vocabulary, mapping, endpoints.far, model);
    let own = own_type(mapping, endpoints, model, &translator)?;
    let mut proxy_model = ActionModel::of(mapping.proxy.as_str(), endpoints.near.0.name.clone());
    proxy_model.types = declared_types(vocabulary, endpoints.near.0, &translator);
    proxy_model.predicates = declared_predicates(vocabulary, endpoints, model, &translator);
    proxy_model.functions = declared_functions(vocabulary, endpoints, model, &translator);
    proxy_model.objects = objects(vocabulary, mapping, endpoints, model, &translator, &own);
    let mut standing = facts(&endpoints.far.1.init, &translator);
    standing.extend(add_guards(vocabulary, mapping, endpoints, &mut proxy_model));
    proxy_model.init = standing.clone();
    let own_facts = facts(&model.init, &translator);
    proxy_model.init.extend(own_facts.into_iter().filter(|fact| !standing.contains(fact)));
    let (mut timeouts, mut left_out) = (BTreeMap::new(), Vec::new());
    for (action, near) in &mapping.actions {
        let offered = model.actions.iter().find(|schema| schema.name == action.as_str());
        let is_durative = || model.durative_actions.iter().any(|it| it.name == action.as_str());
        let exported = match offered {
            Some(schema) => exported_schema(schema, near, mapping, endpoints, &translator, &own),
            None if is_durative() => Err(ExportError::Durative),
            None => Err(ExportError::NotOffered),
        };
        match exported {
            Ok(schema) => {
                proxy_model.actions.push(schema);
                let timeout = methods.get(action).map_or(Duration::ZERO, |it| it.timeout.0);
                timeouts.insert(near.as_str().to_owned(), timeout);
            }
            Err(why) => {
                let (action, near) = (action.clone(), near.as_str().to_owned());
                left_out.push(ExcludedAction { action, near, why });
            }
        }
    }
    Ok(ExportedModel { model: proxy_model, constant_facts: standing, timeouts, excluded: left_out })
}

/// Returns the type of the proxy agent: the narrowest exported type that contains the real agent.
/// Returns an error if the agent is not declared, or if no such type is exported.
fn own_type(
    mapping: &AgentMapping,
    endpoints: EcosystemFiles<'_>,
    model: &ActionModel,
    translator: &Translator<'_>,
) -> Result<TypeExpr, String> {
    let brought = model.objects.iter().map(|declared| &declared.object);
    let mapped = endpoints.far.1.objects.iter().map(|declared| &declared.object);
    let own = { brought.chain(mapped) }.find(|object| object.name == mapping.agent.as_str());
    let own = own.ok_or_else(|| format!("`{}` does not say what it is", mapping.agent))?;
    translator
        .nearest_type(&own.ty)
        .ok_or_else(|| format!("`{}` is of the type `{}`, which is not exported", own.name, own.ty))
}

/// Returns the exported types that the near ontology does not declare.
fn declared_types(
    vocabulary: &InterfaceVocabulary,
    near: &Domain,
    translator: &Translator<'_>,
) -> Vec<Typed> {
    let is_new = |name: &Name| *name != "object" && near.types.iter().all(|it| it.name != *name);
    let declared = vocabulary.types.iter().filter(|(_, name)| is_new(name));
    declared
        .map(|(far, name)| {
            let above = translator.nearest_supertype(far);
            Typed { name: name.clone(), ty: above.unwrap_or_default() }
        })
        .collect()
}

fn declared_predicates(
    vocabulary: &InterfaceVocabulary,
    endpoints: EcosystemFiles<'_>,
    model: &ActionModel,
    translator: &Translator<'_>,
) -> Vec<PredicateDeclaration> {
    let near = &endpoints.near.0.predicates;
    let far = endpoints.far.0.predicates.iter().chain(&model.predicates);
    far.filter_map(|declared| {
        let name = translator.predicate(&declared.name).ok()?;
        let is_new = near.iter().all(|it| it.name != name);
        translator.reset_variables();
        let parameters = translator.typed(&declared.parameters).ok()?;
        is_new.then_some(PredicateDeclaration { name, parameters, privacy: Privacy::Public })
    })
    .filter(|declared| vocabulary.predicates.values().any(|name| *name == declared.name))
    .collect()
}

fn declared_functions(
    vocabulary: &InterfaceVocabulary,
    endpoints: EcosystemFiles<'_>,
    model: &ActionModel,
    translator: &Translator<'_>,
) -> Vec<FunctionDeclaration> {
    let near = &endpoints.near.0.functions;
    let far = endpoints.far.0.functions.iter().chain(&model.functions);
    far.filter_map(|declared| {
        let name = vocabulary.functions.get(declared.name.as_str())?.clone();
        let is_private = translator.is_private(declared.name.as_str());
        let is_new = near.iter().all(|it| it.name != name);
        translator.reset_variables();
        let parameters = translator.typed(&declared.parameters).ok()?;
        let declared = FunctionDeclaration { name, parameters, privacy: Privacy::Public };
        (is_new && !is_private).then_some(declared)
    })
    .collect()
}

/// Returns the objects of the proxy agent's model: the proxy agent itself, and the exported objects
/// that the near map does not declare.
fn objects(
    vocabulary: &InterfaceVocabulary,
    mapping: &AgentMapping,
    endpoints: EcosystemFiles<'_>,
    model: &ActionModel,
    translator: &Translator<'_>,
    own: &TypeExpr,
) -> Vec<ObjectDeclaration> {
    let declare = |name: Name, ty: TypeExpr| ObjectDeclaration {
        object: Typed { name, ty },
        privacy: Privacy::Public,
    };
    let mut objects = vec![declare(Name::new(mapping.proxy.as_str()), own.clone())];
    let near_map = endpoints.near.1.objects.iter().map(|declared| &declared.object);
    let near: Vec<&Name> =
        near_map.chain(&endpoints.near.0.constants).map(|object| &object.name).collect();
    let brought = model.objects.iter().map(|declared| &declared.object);
    let mapped = endpoints.far.1.objects.iter().map(|declared| &declared.object);
    for object in brought.chain(mapped).chain(&endpoints.far.0.constants) {
        let Some(name) = vocabulary.objects.get(object.name.as_str()) else { continue };
        if near.contains(&name) || translator.is_private(object.name.as_str()) {
            continue;
        }
        let is_there = objects.iter().any(|declared| declared.object.name == *name);
        if let Some(ty) = translator.nearest_type(&object.ty).filter(|_| !is_there) {
            objects.push(declare(name.clone(), ty));
        }
    }
    objects
}

/// Returns the translations of those facts in `said` that are exported, each once.
fn facts(said: &[InitElement], translator: &Translator<'_>) -> Vec<InitElement> {
    let mut facts: Vec<InitElement> = Vec::new();
    for fact in said.iter().filter_map(|fact| translator.fact(fact)) {
        if !facts.contains(&fact) {
            facts.push(fact);
        }
    }
    facts
}

/// Declares the predicate `mapping.guard` in the proxy agent's model. Returns one fact of this
/// predicate for each exported object, so that actions can use exported objects only.
fn add_guards(
    vocabulary: &InterfaceVocabulary,
    mapping: &AgentMapping,
    endpoints: EcosystemFiles<'_>,
    proxy_model: &mut ActionModel,
) -> Vec<InitElement> {
    let parameters = vec![Typed { name: Name::new("thing"), ty: TypeExpr::default() }];
    let name = mapping.guard.clone();
    proxy_model.predicates.push(PredicateDeclaration {
        name,
        parameters,
        privacy: Privacy::Public,
    });
    let near_map = endpoints.near.1.objects.iter().map(|declared| &declared.object);
    let near = near_map.chain(&endpoints.near.0.constants).map(|object| &object.name);
    let near: Vec<&Name> =
        near.filter(|name| vocabulary.objects.values().any(|it| it == *name)).collect();
    let brought = proxy_model.objects.iter().map(|declared| &declared.object.name);
    let shared: Vec<Name> = near.into_iter().chain(brought).cloned().collect();
    let fact = |name: Name| InitElement::Atom(guard_atom(&mapping.guard, Term::Object(name)));
    shared.into_iter().map(fact).collect()
}

fn guard_atom(guard: &Name, thing: Term) -> Atom {
    Atom { predicate: guard.clone(), arguments: vec![thing], span: Span::default() }
}

/// Returns an action in the names of the near side, or the reason why it cannot be exported.
fn exported_schema(
    schema: &ActionSchema,
    near: &Name,
    mapping: &AgentMapping,
    endpoints: EcosystemFiles<'_>,
    translator: &Translator<'_>,
    own: &TypeExpr,
) -> Result<ActionSchema, ExportError> {
    if !schema.partners.is_empty() {
        return Err(ExportError::Joint);
    }
    translator.reset_variables();
    // Only the proxy agent offers the action, whichever agent the schema is for.
    let agent = Typed { name: translator.variable(&agent_variable(schema)), ty: own.clone() };
    let mut parameters = Vec::new();
    for parameter in &schema.parameters {
        let ty = translator.exact_type(&parameter.ty);
        let ty = ty.map_err(|lost| ExportError::Parameter(parameter.name.clone(), lost))?;
        parameters.push(Typed { name: translator.variable(&parameter.name), ty });
    }
    let needed = translator.precondition(&schema.precondition).map_err(ExportError::Condition)?;
    let variables = parameters.iter().map(|it| Term::Variable(it.name.clone()));
    let guards = variables.map(|it| Condition::Atom(guard_atom(&mapping.guard, it)));
    let precondition = Condition::And([needed].into_iter().chain(guards).collect());
    let effect = translator.effect(&schema.effect).map_err(ExportError::Effect)?;
    let effect = effect.ok_or(ExportError::NoEffect)?;
    let cost = match mapping.costs.get(near.as_str()) {
        Some(cost) => Some(Expression::Number(Number(*cost))),
        None => translator.cost(&schema.effect).map_err(ExportError::Cost)?,
    };
    let is_measured = endpoints.near.0.functions.iter().any(|it| it.name == TOTAL_COST);
    let effect = match cost.filter(|_| is_measured) {
        Some(cost) => Effect::And(vec![effect, cost_effect(cost)]),
        None => effect,
    };
    // A predicate that is not exported cannot be observed on the near side.
    let observe = schema.observe.iter().filter_map(|it| translator.observed(it).ok()).collect();
    let span = Span::default();
    Ok(ActionSchema {
        name: near.clone(),
        agent: Some(agent),
        partners: Vec::new(),
        parameters,
        precondition,
        effect,
        observe,
        span,
    })
}

/// Returns the name of the variable that stands for the acting agent in an action.
fn agent_variable(schema: &ActionSchema) -> Name {
    schema.agent.as_ref().map_or_else(|| Name::new("self"), |agent| agent.name.clone())
}

fn cost_effect(value: Expression) -> Effect {
    let fluent = FluentTerm {
        function: Name::new(TOTAL_COST),
        arguments: Vec::new(),
        span: Span::default(),
    };
    let (assignment, span) = (Assignment::Increase, Span::default());
    Effect::Assign(Box::new(Assign { assignment, fluent, value, span }))
}

/// Translates a goal. Returns an error, as text for a person, if the goal is not a conjunction of
/// facts, or if a predicate in it is not in `predicates`, or if a name in it is not exported.
pub(crate) fn goal(
    text: &str,
    predicates: &BTreeSet<String>,
    translator: &Translator<'_>,
) -> Result<String, String> {
    let parsed = pddl::parse_condition(text).into_result();
    let condition = parsed.map_err(|found| {
        found.first().map_or_else(|| "it cannot be read".to_owned(), |found| found.located(text))
    })?;
    let mut said = Vec::new();
    for atom in atoms(&condition)? {
        if !predicates.contains(atom.predicate.as_str()) {
            let allowed: Vec<_> = predicates.iter().map(|name| format!("`{name}`")).collect();
            return Err(format!(
                "goals about `{}` do not pass; only about {}",
                atom.predicate,
                allowed.join(", ")
            ));
        }
        if let Some(Term::Variable(name)) =
            atom.arguments.iter().find(|term| matches!(term, Term::Variable(_)))
        {
            return Err(format!("`?{name}` is a variable: a goal that passes names its objects"));
        }
        let fact = translator.fact(&InitElement::Atom(atom.clone()));
        let fact = fact.ok_or_else(|| format!("`{atom}` names what is not exported"))?;
        said.push(fact.to_string());
    }
    Ok(format!("(and {})", said.join(" ")))
}

/// Returns the facts in a conjunction of facts. Returns an error, as text for a person, if the
/// condition has any other form.
fn atoms(condition: &Condition) -> Result<Vec<&Atom>, String> {
    match condition {
        Condition::Atom(atom) => Ok(vec![atom]),
        Condition::And(parts) if !parts.is_empty() => {
            let parts = parts.iter().map(atoms).collect::<Result<Vec<_>, _>>()?;
            Ok(parts.into_iter().flatten().collect())
        }
        other => Err(format!("`{other}` does not pass: only facts, and `and` of them")),
    }
}

impl fmt::Display for ExcludedAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ExcludedAction { action, why, .. } = self;
        match why {
            ExportError::NotOffered => {
                write!(f, "`{action}` is not exported: its agent does not offer it")
            }
            ExportError::Condition(lost) => {
                write!(f, "`{action}` is not exported: it needs {lost}")
            }
            ExportError::Parameter(name, lost) => {
                write!(f, "`{action}` is not exported: its parameter `?{name}` is of {lost}")
            }
            ExportError::Effect(lost) => {
                write!(f, "`{action}` is not exported: what it changes depends on {lost}")
            }
            ExportError::Cost(lost) => {
                write!(f, "`{action}` is not exported: its cost depends on {lost}")
            }
            ExportError::NoEffect => {
                write!(f, "`{action}` is not exported: nothing that it changes is exported")
            }
            ExportError::Durative => {
                write!(f, "`{action}` is not exported: it is a durative action")
            }
            ExportError::Joint => {
                write!(f, "`{action}` is not exported: several agents act in it")
            }
        }
    }
}

impl ExcludedAction {
    /// Returns advice on how to change the rule so that the action can be exported; `None` if no
    /// change of the rule helps.
    pub fn help(&self) -> Option<String> {
        let ExcludedAction { near, why, .. } = self;
        match why {
            ExportError::Condition(Untranslatable::Unexported(sort, name))
            | ExportError::Parameter(_, Untranslatable::Unexported(sort, name))
            | ExportError::Effect(Untranslatable::Unexported(sort, name)) => Some(format!(
                "a plan there could have steps that cannot be carried out; export `{name}` \
                 too, under `{sort}s`, or leave the action out"
            )),
            ExportError::Cost(_) => {
                Some(format!("say what it is to cost here: costs = {{ {near} = 5 }}"))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use acl::{AgentId, EcosystemId};

    use super::*;

    const FAR: &str = "(define (domain far) (:types place robot - object hall - place)
        (:predicates (at ?r - robot ?p - place) (lit ?p - place) (dark ?p - place)
            (:private (wired ?p - place)))
        (:functions (total-cost) (meters ?a ?b - place))
        (:derived (dark ?p - place) (not (lit ?p))))";
    const FAR_MAP: &str = "(define (problem m) (:domain far)
        (:objects h1 h2 - hall vault - place (:private safe - place)) (:init (lit h1) (lit vault) (= (meters h1 h2) 3))
        (:goal (and)))";
    const NEAR: &str =
        "(define (domain near) (:types spot - object) (:predicates (bright ?s - spot))
        (:functions (total-cost)))";
    const NEAR_MAP: &str = "(define (problem n) (:domain near) (:objects here - spot) (:init)
        (:goal (and)))";

    fn table(pairs: &[(&str, &str)]) -> BTreeMap<String, Name> {
        pairs.iter().map(|(far, near)| ((*far).to_owned(), Name::new(near))).collect()
    }

    /// Returns the exported form of one action of the robot `r1`. On the near side, the action is
    /// `do` of the agent `helper`.
    fn exported(action: &str) -> Result<String, String> {
        let vocabulary = InterfaceVocabulary {
            types: table(&[("place", "spot"), ("robot", "aide")]),
            predicates: table(&[
                ("at", "is-in"),
                ("lit", "bright"),
                ("dark", "gloomy"),
                ("wired", "wet"),
            ]),
            functions: table(&[]),
            objects: table(&[("h1", "here"), ("h2", "there"), ("safe", "strongbox")]),
        };
        let agent = |name| AgentId::new(name).expect("a name");
        let mapping = AgentMapping {
            agent: agent("r1"),
            proxy: agent("helper"),
            guard: Name::new(&format!("shared-with-{}", EcosystemId::new("far").expect("a name"))),
            actions: table(&[("act", "do")]),
            costs: BTreeMap::new(),
        };
        let model = format!(
            "(define (agent r1) (:domain far) (:types bot - robot)
               (:predicates (:private (charged ?r - bot)))
               (:objects r1 - bot) (:init (at r1 h1) (charged r1)) {action})"
        );
        let domain = |text| pddl::parse_domain(text).into_result().expect("a domain");
        let problem = |text| pddl::parse_problem(text).into_result().expect("a map");
        let (far, near) = ((domain(FAR), problem(FAR_MAP)), (domain(NEAR), problem(NEAR_MAP)));
        let endpoints = EcosystemFiles { far: (&far.0, &far.1), near: (&near.0, &near.1) };
        let model = pddl::parse_action_model(&model).into_result().expect("a model");
        let exported = export(&vocabulary, &mapping, endpoints, &model, &Methods::new())?;
        match exported.excluded.first() {
            Some(left_out) => Err(left_out.to_string()),
            None => {
                let found = pddl::check_action_model(&near.0, &exported.model);
                let text = exported.model.to_string();
                assert!(found.iter().all(|found| !found.is_error()), "{found:?}\n{text}");
                for secret in [
                    "charged",
                    "wired",
                    "wet",
                    "vault",
                    "r1",
                    "bot",
                    "lit",
                    "h1",
                    "dark",
                    "safe",
                    "strongbox",
                    "merger",
                ] {
                    assert!(!text.contains(secret), "`{secret}` is in {text}");
                }
                Ok(text)
            }
        }
    }

    fn action(parameters: &str, precondition: &str, effect: &str) -> String {
        format!(
            "(:action act :agent ?r - bot :parameters ({parameters}) :precondition {precondition}
               :effect {effect})"
        )
    }

    #[test]
    fn an_exported_model_contains_every_exported_part() {
        let text = exported(&action(
            "?p - place",
            "(and (at ?r ?p) (charged ?r) (not (lit ?p)))",
            "(and (lit ?p) (not (charged ?r)) (increase (total-cost) 3))",
        ));
        let text = text.expect("exported");
        for said in [
            "(:objects helper - aide there - spot)",
            "(is-in helper here)",
            "(shared-with-far here)",
            "(is-in ?x1 ?x2)",
            "(not (bright ?x2))",
            "(shared-with-far ?x2)",
            "(increase (total-cost) 3)",
        ] {
            assert!(text.contains(said), "`{said}` is not in {text}");
        }
    }

    #[test]
    fn an_action_with_an_untranslatable_part_is_excluded() {
        let lights = "(lit ?p)";
        for (parameters, precondition, effect, why) in [
            ("?p - place", "(or (charged ?r) (at ?r ?p))", lights, "`charged`, which is private"),
            ("?p - place", "(not (and (charged ?r) (lit ?p)))", lights, "which is private"),
            ("?p - place", "(at ?r vault)", lights, "the object `vault`"),
            ("?p - place", "(dark ?p)", lights, "follows by axioms"),
            ("?p - place", "(forall (?q - place) (lit ?q))", lights, "not all are exported"),
            ("?p - place", "(not (exists (?q - place) (lit ?q)))", lights, "not all are exported"),
            ("?p - hall", "(at ?r ?p)", lights, "its parameter `?p` is of the type `hall`"),
            ("?p - place", "(at ?r ?p)", "(when (charged ?r) (lit ?p))", "what it changes depends"),
            ("?p - place", "(at ?r ?p)", "(not (charged ?r))", "nothing that it changes"),
            (
                "?p - place",
                "(at ?r ?p)",
                "(and (lit ?p) (increase (total-cost) (meters ?p ?p)))",
                "its cost depends on the function `meters`",
            ),
        ] {
            let left_out = exported(&action(parameters, precondition, effect)).expect_err(why);
            assert!(left_out.contains(why), "{precondition} {effect}: {left_out}");
        }
        let other = action("", "()", "()").replace("action act", "action other");
        assert!(exported(&other).expect_err("not offered").contains("does not offer"));
    }

    /// The name of a variable is one of the agent's symbols too, so it is not passed on.
    #[test]
    fn variables_are_renamed_to_numbers_and_keep_their_bindings() {
        let text = exported(&action(
            "?merger-room - place",
            "(and (at ?r ?merger-room)
                (exists (?merger - place) (and (lit ?merger) (not (lit ?merger-room)))))",
            "(forall (?merger-room - place) (when (at ?r ?merger-room) (lit ?merger-room)))",
        ));
        let text = text.expect("exported");
        for said in [
            "?x2 - spot",
            "(exists (?x3 - spot) (and (bright ?x3) (not (bright ?x2))))",
            "(forall (?x2 - spot) (when (is-in ?x1 ?x2) (bright ?x2)))",
        ] {
            let on_one_line = text.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(on_one_line.contains(said), "`{said}` is not in {text}");
        }
    }

    #[test]
    fn a_private_object_of_the_map_is_not_exported() {
        let secret = action("?p - place", "(at ?r safe)", "(lit ?p)");
        let left_out = exported(&secret).expect_err("it is private");
        assert!(left_out.contains("`safe`, which is private"), "{left_out}");
    }

    #[test]
    fn a_condition_over_private_symbols_alone_is_left_to_the_agent() {
        for precondition in
            ["(charged ?r)", "(wired ?p)", "(not (charged ?r))", "(or (charged ?r) (wired ?p))"]
        {
            let text = exported(&action("?p - place", precondition, "(lit ?p)"));
            assert!(text.is_ok(), "{precondition}: {text:?}");
        }
    }
}
