//! The Actuator class (the paper, “Actuators”): what every sensor, camera and robot inherits.
//!
//! - Announces the action model on activation, on change, and says at every heartbeat that it
//!   works and what it knows.
//! - Executes an action within what it advertises, when asked, at most once per token.
//! - Has its own planner and its own domain, made of what its daemon hears, and answers a call
//!   for proposals with what it can do alone, with the agents it carries (the paper,
//!   “Decentralized Planning”).
//! - Speaks up by itself: announces at once what happened to its device, asks for goals, asks people.
//!
//! A plugin implements [`Device`]: its model, its facts, its methods. Everything above is here.

mod actuator;
mod bidding;
mod device;
mod initiative;
mod ledger;
mod mobile_base;
mod on_off;
mod text;

pub use actuator::Actuator;
pub use agent::StateFolder;
pub use device::{Call, Description, Device, Failure, OwnFact, Performed};
pub use initiative::{Initiative, News, Stir};
pub use mobile_base::{BaseConfig, BaseDriver, MobileBase, Moved};
pub use on_off::{OnOff, is_derived};
pub use substrate::BoxFuture;
pub use text::{InvalidPlace, Place, facts_of, model_of};
