//! What an actuator keeps to itself in an ecosystem with `privacy = "agents"`: what its action model
//! declares `:private`, and the facts about it.
//!
//! The device knows nothing of it. Everything that leaves the actuator passes through here: the model
//! that it announces, the facts of its heartbeats and its observations. `skeleton` decides what may be
//! told.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Methods};
use agent::{Host, ModelPrivacy};
use pddl::{ActionModel, Domain, InitElement, Name, Privacy, Problem};
use skeleton::{ConfidentialModel, FillRefusal};

use crate::device::{Description, OwnFact};

/// Number of the longest steps of the device for which an announced action may last. The requester
/// cannot know how many private steps the action takes; ways to a private place and back take three or
/// four. Each step also has its own time limit.
const STEPS_TIMED: u32 = 8;

/// Decides what an actuator announces of its device.
pub(crate) struct Confidentiality {
    ontology: Arc<Domain>,
    map: Arc<Problem>,
    /// A mutex, because an agent answers for its model without being changed.
    models: Mutex<KnownModels>,
}

#[derive(Default)]
struct KnownModels {
    /// The last model of the device, and what may be told of it.
    current: Option<(ActionModel, Announceable)>,
    /// The last model that declared something `:private`: what is announced once is announced from then on, and opaque
    /// names keep their meaning.
    former: Option<Arc<ConfidentialModel>>,
}

/// What may be told of a device's action model.
#[derive(Clone)]
enum Announceable {
    /// Everything: nothing in it is private.
    Whole,
    /// The public part.
    Part(Arc<ConfidentialModel>),
    /// Nothing but public names and types: there is no projection of the model.
    Nothing,
}

// === impl Confidentiality ===

impl Confidentiality {
    /// Returns the filter of an actuator of `host`; `None` if agents keep nothing from each other.
    pub(crate) fn of(host: &Host) -> Option<Confidentiality> {
        let (ontology, map) = (Arc::clone(&host.ontology), Arc::clone(&host.map));
        match host.settings.privacy {
            ModelPrivacy::Ecosystem => None,
            ModelPrivacy::Agents => {
                Some(Confidentiality { ontology, map, models: Mutex::default() })
            }
        }
    }

    /// Checks that a model can be announced without what it declares `:private`.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person.
    pub(crate) fn check(&self, model: &ActionModel) -> Result<(), String> {
        let made = ConfidentialModel::new(model, &self.ontology, &self.map, None);
        made.map(|_| ()).map_err(|why| format!("privacy = \"agents\": {why}"))
    }

    /// Returns the actions of a model that others do not see.
    pub(crate) fn private_actions(&self, described: &Description) -> Vec<String> {
        let announced = self.announced(described.clone()).model.actions;
        let own = described.model.actions.iter();
        let hidden = own.filter(|own| !announced.iter().any(|told| told.name == own.name));
        hidden.map(|action| action.name.as_str().to_owned()).collect()
    }

    /// Returns what the actuator announces of its device.
    pub(crate) fn announced(&self, described: Description) -> Description {
        let Description { model, methods } = described;
        match self.announceable(&model) {
            Announceable::Whole => Description { model, methods },
            Announceable::Part(part) => {
                let model = part.announced().clone();
                let methods = announced_methods(&model, &methods);
                Description { model, methods }
            }
            Announceable::Nothing => {
                Description { model: nameless(model), methods: Methods::default() }
            }
        }
    }

    /// Returns the facts of the device that the actuator announces. `knows` says whether another agent declares an object.
    pub(crate) fn announced_facts(
        &self,
        facts: Vec<OwnFact>,
        knows: &dyn Fn(&Name) -> bool,
    ) -> Vec<OwnFact> {
        match self.last() {
            Announceable::Whole => facts,
            Announceable::Part(part) => {
                let told = facts.into_iter().filter_map(|OwnFact { fact, known_for }| {
                    Some(OwnFact { fact: part.announced_fact(&fact, knows)?, known_for })
                });
                told.collect()
            }
            Announceable::Nothing => Vec::new(),
        }
    }

    /// Whether the device has something that may not be told.
    pub(crate) fn hides_something(&self) -> bool {
        !matches!(self.last(), Announceable::Whole)
    }

    /// Returns the observations of a method that the actuator reports.
    pub(crate) fn announced_observations(
        &self,
        observed: Vec<InitElement>,
        knows: &dyn Fn(&Name) -> bool,
    ) -> Vec<InitElement> {
        let facts = observed.into_iter().map(OwnFact::from).collect();
        self.announced_facts(facts, knows).into_iter().map(|fact| fact.fact).collect()
    }

    /// Returns the model of a device that declares something `:private`; `None` for any other.
    pub(crate) fn private_model(&self, model: &ActionModel) -> Option<Arc<ConfidentialModel>> {
        match self.announceable(model) {
            Announceable::Part(part) => Some(part),
            Announceable::Whole | Announceable::Nothing => None,
        }
    }

    /// Whether a goal, as PDDL, is about something private.
    pub(crate) fn is_about_private(&self, goal: &str) -> bool {
        let condition = pddl::parse_condition(goal).into_result();
        match (self.last(), condition) {
            (Announceable::Whole, _) => false,
            (Announceable::Part(part), Ok(condition)) => part.is_about_private(&condition),
            (Announceable::Part(_), Err(_)) | (Announceable::Nothing, _) => true,
        }
    }

    /// Announces more from now on, after a proved refusal that was made with `model`. A refusal that was
    /// made with a former model proves nothing of the present one. Returns whether the present model is
    /// another one than `model`.
    pub(crate) fn sharpen(&self, refusal: &FillRefusal, model: &Arc<ConfidentialModel>) -> bool {
        let mut models = self.lock();
        let KnownModels { current, former } = &mut *models;
        match current {
            Some((_, Announceable::Part(part))) if Arc::ptr_eq(part, model) => {
                let mut sharper = ConfidentialModel::clone(part);
                let is_sharper = sharper.sharpen(refusal);
                if is_sharper {
                    *part = Arc::new(sharper);
                    *former = Some(Arc::clone(part));
                }
                is_sharper
            }
            _ => true,
        }
    }

    fn lock(&self) -> MutexGuard<'_, KnownModels> {
        self.models.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns what may be told of the last model. Before there was one, nothing may.
    fn last(&self) -> Announceable {
        let models = self.lock();
        models.current.as_ref().map_or(Announceable::Nothing, |(_, it)| it.clone())
    }

    fn announceable(&self, model: &ActionModel) -> Announceable {
        let mut models = self.lock();
        if let Some((known, announceable)) = &models.current
            && known == model
        {
            return announceable.clone();
        }
        let former = models.former.as_deref();
        let announceable = match ConfidentialModel::new(model, &self.ontology, &self.map, former) {
            Ok(None) => Announceable::Whole,
            Ok(Some(part)) => {
                let part = Arc::new(part);
                models.former = Some(Arc::clone(&part));
                Announceable::Part(part)
            }
            Err(why) => {
                tracing::error!(agent = %model.agent, why, "its model is not announced");
                Announceable::Nothing
            }
        };
        models.current = Some((model.clone(), announceable.clone()));
        announceable
    }
}

/// Returns the methods of announced actions: without arguments, which would name private parameters.
fn announced_methods(announced: &ActionModel, own: &Methods) -> Methods {
    let longest = own.values().map(|method| method.timeout.0).max().unwrap_or(Duration::ZERO);
    let method = |name: &str| Method {
        method: name.to_owned(),
        arguments: Default::default(),
        timeout: Millis(longest.saturating_mul(STEPS_TIMED)),
    };
    let names = announced.actions.iter().map(|action| action.name.as_str());
    names.map(|name| (name.to_owned(), method(name))).collect()
}

/// Returns a model without actions, facts and private declarations.
fn nameless(model: ActionModel) -> ActionModel {
    let mut model = model;
    model.predicates.retain(|it| it.privacy == Privacy::Public);
    model.functions.retain(|it| it.privacy == Privacy::Public);
    model.objects.retain(|it| it.privacy == Privacy::Public);
    model.init.clear();
    model.derived.clear();
    model.actions.clear();
    model.durative_actions.clear();
    model
}
