//! The Actuator class (the paper, “Actuators”): base of every sensor, camera and robot.
//!
//! - Announces its action model on activation and on every change. Sends its facts with every
//!   heartbeat.
//! - Executes an announced action on request, at most once per token.
//! - Has its own planner and its own local domain, composed of what its daemon receives. Answers a call
//!   for proposals with plans for what it can do alone or with the agents it carries (the paper,
//!   “Decentralized Planning”).
//! - Takes initiatives: announces events of its device at once, requests goals, asks people.
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
