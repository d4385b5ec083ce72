//! The Actuator class (the paper, “Actuators”): base of every sensor, camera and robot.
//!
//! - Announces its action model on activation and on every change. Sends its facts with every
//!   heartbeat.
//! - Executes an announced action on request, at most once per token.
//! - Has its own planner and its own local domain, composed of the messages that its daemon
//!   receives. Answers a call for proposals with plans for the conjuncts that it can reach alone or
//!   with the agents it carries (the paper, “Decentralized Planning”). Agrees to its part of a
//!   joint plan if it can do this part.
//! - Keeps what its model declares `:private` to itself if the host says so (`privacy = "agents"`).
//! - Keeps the safeguards of the host: asks people before an action, and limits how often it
//!   begins.
//! - Acts by itself: announces events of its device at once, requests goals, asks people questions.
//!
//! A plugin implements [`Device`], with the model, the facts and the methods of its device. This
//! crate does the rest.

mod actuator;
mod agreeing;
mod begun_actions;
mod bidding;
mod commitment;
mod confidentiality;
mod declared;
mod device;
mod erased_device;
mod initiative;
mod ledger;
mod measured_value;
mod on_off;
mod pddl_text;
mod private_planning;
mod safeguards;
mod unchangeable;

pub use actuator::Actuator;
pub use agent::StateFolder;
pub use declared::{
    AgentFacts, FactFile, UncertainEffect, check_effect, checked_model, declared_model,
    misspelt_placeholder, placeholders, stored_facts,
};
pub use device::{Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact};
pub use initiative::{DeviceEvent, Initiative, InitiativeUpdate};
pub use measured_value::{converted_value, is_possible_value, unit_conversion};
pub use on_off::{OnOffNames, OnOffPredicates, is_derived};
pub use pddl_text::{InvalidPlaceName, PlaceName, facts_of, model_of};
pub use safeguards::{ActionSafeguard, BEGINNINGS_MAX, BeginLimit, Safeguards};
pub use substrate::BoxFuture;
