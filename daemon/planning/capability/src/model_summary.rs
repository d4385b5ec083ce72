//! The summary of a model (its manifest). A model is divided into its parts once, on arrival, in a
//! form that composition can compare and copy.
//!
//! The shared ontology is divided in the same way, so that models can be compared with it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::{
    ActionModel, ActionSchema, Derived, Domain, Effect, FunctionDeclaration, InitElement, Name,
    ObjectDeclaration, PredicateDeclaration, Privacy, Problem, TOTAL_COST, TypeExpr, Typed,
};

use crate::canonical::{self, CanonicalText, UsedSymbols};
use crate::conflict::{ModelPart, ModelPartKind};
use crate::declined::Declined;
use crate::fact::{FactKey, FactStatement, FactSymbolKind, FactValue};
use crate::limits;

/// The declaration of a type, a predicate, a function or an object.
#[derive(Clone, Debug)]
pub(crate) struct Declaration {
    pub(crate) subject: ModelPart,
    pub(crate) item: DeclaredItem,
    /// Canonical text of the types in the declaration.
    pub(crate) signature: CanonicalText,
    /// For a predicate: the axioms that derive it, in the order of their canonical texts. Otherwise
    /// empty.
    pub(crate) axioms: Vec<ModelAxiom>,
    pub(crate) private: bool,
}

/// The declared type, predicate, function or object, as it is written in the model.
#[derive(Clone, Debug)]
pub(crate) enum DeclaredItem {
    Type(Typed),
    Predicate(PredicateDeclaration),
    Function(FunctionDeclaration),
    Object(ObjectDeclaration),
}

/// An axiom with its canonical text.
#[derive(Clone, Debug)]
pub(crate) struct ModelAxiom {
    pub(crate) key: CanonicalText,
    pub(crate) uses: UsedSymbols,
    pub(crate) tree: Derived,
}

/// An action that an agent offers.
#[derive(Clone, Debug)]
pub(crate) struct ModelAction {
    /// Canonical text of the action. Offers of several agents with the same name and the same
    /// canonical text are one schema.
    pub(crate) key: CanonicalText,
    pub(crate) uses: UsedSymbols,
    pub(crate) schema: Arc<ActionSchema>,
}

/// A part of a model that cannot be used, with the reason.
#[derive(Clone, Debug)]
pub(crate) struct ModelFlaw {
    pub(crate) subject: ModelPart,
    pub(crate) detail: String,
}

/// Summary of a model: its declarations, actions and facts, prepared for composing.
#[derive(Clone, Debug, Default)]
pub(crate) struct ModelSummary {
    pub(crate) requirements: Vec<Name>,
    pub(crate) declarations: Vec<Declaration>,
    /// Axioms for predicates that the model itself does not declare.
    pub(crate) loose_axioms: Vec<ModelAxiom>,
    pub(crate) offers: Vec<ModelAction>,
    pub(crate) init: Vec<(FactKey, FactValue)>,
    /// Symbols of the facts that the model states at the start and the agent's actions can change.
    /// Each entry tells whether the symbol is a predicate or a function, and its name. The agent's
    /// heartbeats list all true facts with these symbols.
    pub(crate) owned: BTreeSet<(FactSymbolKind, Name)>,
    /// Symbols of all facts that the model states at the start. Each entry tells whether the symbol
    /// is a predicate or a function, and its name.
    pub(crate) said: BTreeSet<(FactSymbolKind, Name)>,
    /// The objects that the model declares.
    pub(crate) objects: BTreeSet<Name>,
    pub(crate) flaws: Vec<ModelFlaw>,
}

// === impl Declaration ===

impl Declaration {
    /// Whether two agents declare a part in the same way: with the same signature and the same
    /// axioms.
    pub(crate) fn agrees(&self, other: &Declaration) -> bool {
        self.signature == other.signature
            && self.axioms.len() == other.axioms.len()
            && self.axioms.iter().zip(&other.axioms).all(|(one, two)| one.key == two.key)
    }

    /// Whether an agent's declaration repeats the declaration `shared` of the ontology. The axioms
    /// may be omitted.
    pub(crate) fn repeats(&self, shared: &Declaration) -> bool {
        self.signature == shared.signature && (self.axioms.is_empty() || self.agrees(shared))
    }

    fn new(kind: ModelPartKind, item: DeclaredItem, privacy: &Privacy) -> Declaration {
        let (name, signature) = match &item {
            DeclaredItem::Type(typed) => (&typed.name, canonical::signature([&typed.ty])),
            DeclaredItem::Object(declared) => {
                (&declared.object.name, canonical::signature([&declared.object.ty]))
            }
            DeclaredItem::Predicate(declared) => {
                (&declared.name, parameters_of(&declared.parameters))
            }
            DeclaredItem::Function(declared) => {
                (&declared.name, parameters_of(&declared.parameters))
            }
        };
        let subject = ModelPart::new(kind, name);
        let private = *privacy != Privacy::Public;
        Declaration { subject, item, signature, axioms: Vec::new(), private }
    }
}

fn parameters_of(parameters: &[Typed]) -> CanonicalText {
    canonical::signature(parameters.iter().map(|parameter| &parameter.ty))
}

// === impl DeclaredItem ===

impl DeclaredItem {
    /// Returns the types that the declaration mentions: the types of the parameters, the type of
    /// the object, or the supertypes of the type.
    pub(crate) fn types(&self) -> Vec<&TypeExpr> {
        match self {
            DeclaredItem::Type(typed) => vec![&typed.ty],
            DeclaredItem::Object(declared) => vec![&declared.object.ty],
            DeclaredItem::Predicate(declared) => {
                declared.parameters.iter().map(|p| &p.ty).collect()
            }
            DeclaredItem::Function(declared) => declared.parameters.iter().map(|p| &p.ty).collect(),
        }
    }
}

// === impl ModelSummary ===

impl ModelSummary {
    /// Divides an agent's model into the parts of a summary. Removes the facts and actions from
    /// `model`, and adds the declaration of `total-cost` to it if its actions have costs.
    ///
    /// Returns an error if the model exceeds a limit.
    pub(crate) fn of_model(model: &mut ActionModel) -> Result<ModelSummary, Declined> {
        within_limits(model)?;
        declare_total_cost(model);
        let mut manifest =
            ModelSummary { requirements: model.requirements.clone(), ..ModelSummary::default() };
        manifest.declare(&model.types, &model.predicates, &model.functions, &model.objects);
        manifest.derive(&model.derived);
        manifest.offers.reserve_exact(model.actions.len());
        for schema in std::mem::take(&mut model.actions) {
            manifest.offer(schema);
        }
        for durative in std::mem::take(&mut model.durative_actions) {
            manifest.flaw(
                ModelPartKind::Action,
                &durative.name,
                "no planner here uses durative actions yet; describe it as an `:action`",
            );
        }
        manifest.know(&std::mem::take(&mut model.init));
        manifest.own();
        // The model and its summary are kept as long as the agent is known, and there may be
        // hundreds of agents.
        model.objects.shrink_to_fit();
        Ok(manifest)
    }

    /// Divides the shared ontology and the objects of the map into the parts of a summary.
    pub(crate) fn of_ontology(ontology: &Domain, map: &Problem) -> ModelSummary {
        let mut manifest = ModelSummary::default();
        let public =
            |object: &Typed| ObjectDeclaration { object: object.clone(), privacy: Privacy::Public };
        let objects: Vec<ObjectDeclaration> =
            ontology.constants.iter().map(public).chain(map.objects.iter().cloned()).collect();
        manifest.declare(&ontology.types, &ontology.predicates, &ontology.functions, &objects);
        manifest.derive(&ontology.derived);
        for schema in &ontology.actions {
            let (key, uses) = canonical::action(schema);
            manifest.offers.push(ModelAction { key, uses, schema: Arc::new(schema.clone()) });
        }
        manifest.know(&map.init);
        manifest
    }

    fn declare(
        &mut self,
        types: &[Typed],
        predicates: &[PredicateDeclaration],
        functions: &[FunctionDeclaration],
        objects: &[ObjectDeclaration],
    ) {
        let count = types.len() + predicates.len() + functions.len() + objects.len();
        self.declarations.reserve_exact(count);
        // The type `object` is predefined; declarations of it are ignored.
        let types = types.iter().filter(|typed| typed.name != "object").map(|typed| {
            Declaration::new(
                ModelPartKind::Type,
                DeclaredItem::Type(typed.clone()),
                &Privacy::Public,
            )
        });
        let predicates = predicates.iter().map(|declared| {
            Declaration::new(
                ModelPartKind::Predicate,
                DeclaredItem::Predicate(declared.clone()),
                &declared.privacy,
            )
        });
        let functions = functions.iter().map(|declared| {
            Declaration::new(
                ModelPartKind::Function,
                DeclaredItem::Function(declared.clone()),
                &declared.privacy,
            )
        });
        let objects = objects.iter().map(|declared| {
            Declaration::new(
                ModelPartKind::Object,
                DeclaredItem::Object(declared.clone()),
                &declared.privacy,
            )
        });
        let mut first: BTreeMap<ModelPart, CanonicalText> = BTreeMap::new();
        for declaration in types.chain(predicates).chain(functions).chain(objects) {
            let Declaration { subject, signature, .. } = &declaration;
            match first.get(subject) {
                None => {
                    first.insert(subject.clone(), signature.clone());
                    self.declarations.push(declaration);
                }
                Some(earlier) if earlier == signature => (),
                Some(_) => {
                    let detail = "it is declared twice, differently; the first is used".to_owned();
                    self.flaws.push(ModelFlaw { subject: subject.clone(), detail });
                }
            }
        }
    }

    fn derive(&mut self, derived: &[Derived]) {
        for tree in derived {
            let (key, uses) = canonical::axiom(tree);
            let axiom = ModelAxiom { key, uses, tree: tree.clone() };
            let declared = self.declarations.iter_mut().find(|declaration| {
                declaration.subject.kind == ModelPartKind::Predicate
                    && declaration.subject.name == tree.predicate
            });
            match declared {
                Some(declaration) => declaration.axioms.push(axiom),
                None => self.loose_axioms.push(axiom),
            }
        }
        for declaration in &mut self.declarations {
            declaration.axioms.sort_by(|one, two| one.key.cmp(&two.key));
            declaration.axioms.dedup_by(|one, two| one.key == two.key);
        }
    }

    fn offer(&mut self, schema: ActionSchema) {
        if schema.agent.is_none() {
            let detail = "it has no acting agent; write `:agent ?a - TYPE` before its parameters";
            return self.flaw(ModelPartKind::Action, &schema.name, detail);
        }
        if self.offers.iter().any(|offer| offer.schema.name == schema.name) {
            let detail = "the model has two actions of this name; the first is used";
            return self.flaw(ModelPartKind::Action, &schema.name, detail);
        }
        let (key, uses) = canonical::action(&schema);
        let is_used = |declaration: &&Declaration| {
            let name = &declaration.subject.name;
            let mut symbols = uses.predicates.iter().chain(&uses.functions).map(|(used, _)| used);
            declaration.private && symbols.any(|used| used == name)
        };
        if !schema.partners.is_empty()
            && let Some(private) = self.declarations.iter().find(is_used)
        {
            let detail = format!(
                "several agents act in it, and `{}` is `:private`: the others do not see it; declare \
                 it outside of `:private`",
                private.subject.name
            );
            return self.flaw(ModelPartKind::Action, &schema.name, &detail);
        }
        self.offers.push(ModelAction { key, uses, schema: Arc::new(schema) });
    }

    fn know(&mut self, init: &[InitElement]) {
        self.init.reserve_exact(init.len());
        for element in init {
            match FactStatement::of(element) {
                FactStatement::Is(key, value) => self.init.push((key, value)),
                // A fact that is not listed is already false.
                FactStatement::Not(_) => (),
                FactStatement::Unusable => {
                    let name = Name::new("init");
                    self.flaw(ModelPartKind::Fact, &name, "a fact has objects only, and holds now");
                }
            }
        }
    }

    fn own(&mut self) {
        let uses = || self.offers.iter().map(|offer| &offer.uses);
        let predicates = uses().flat_map(|uses| &uses.changed);
        let functions = uses().flat_map(|uses| &uses.assigned);
        let changed: BTreeSet<(FactSymbolKind, &Name)> = predicates
            .map(|name| (FactSymbolKind::Predicate, name))
            .chain(functions.map(|name| (FactSymbolKind::Function, name)))
            .collect();
        let known = || self.init.iter().map(|(fact, _)| (fact.space(), fact.symbol()));
        let copied = |(space, name): (FactSymbolKind, &Name)| (space, name.clone());
        self.owned = known().filter(|like| changed.contains(like)).map(copied).collect();
        self.said = known().map(copied).collect();
        let objects =
            self.declarations.iter().filter(|it| it.subject.kind == ModelPartKind::Object);
        self.objects = objects.map(|it| it.subject.name.clone()).collect();
    }

    fn flaw(&mut self, kind: ModelPartKind, name: &Name, detail: &str) {
        self.flaws
            .push(ModelFlaw { subject: ModelPart::new(kind, name), detail: detail.to_owned() });
    }
}

/// Adds the declaration of `total-cost` to `model`, if an action has a cost and the model does not
/// declare the function. `total-cost` has the same meaning in every model, so an action must not be
/// left out of the composition because no model and no ontology declares it.
fn declare_total_cost(model: &mut ActionModel) {
    let mut effects = model.actions.iter().flat_map(|action| action.effect.parts());
    let has_costs = effects
        .any(|part| matches!(part, Effect::Assign(assign) if assign.fluent.function == TOTAL_COST));
    if has_costs && model.functions.iter().all(|declared| declared.name != TOTAL_COST) {
        model.functions.push(FunctionDeclaration {
            name: Name::new(TOTAL_COST),
            parameters: Vec::new(),
            privacy: Privacy::Public,
        });
    }
}

fn within_limits(model: &ActionModel) -> Result<(), Declined> {
    let declarations =
        model.types.len() + model.predicates.len() + model.functions.len() + model.derived.len();
    let actions = model.actions.len() + model.durative_actions.len();
    let bounds = [
        ("actions in a model", actions, limits::ACTIONS_PER_AGENT_MAX),
        ("declarations in a model", declarations, limits::DECLARATIONS_PER_AGENT_MAX),
        ("objects in a model", model.objects.len(), limits::OBJECTS_PER_AGENT_MAX),
        ("facts of one owner", model.init.len(), limits::FACTS_PER_OWNER_MAX),
    ];
    match bounds.into_iter().find(|(_, count, limit)| count > limit) {
        Some((what, _, limit)) => Err(Declined::TooMany { what, limit }),
        None => Ok(()),
    }
}
