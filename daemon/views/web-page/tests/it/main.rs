//! The server over real sockets: what browsers are sent, and what forged, slow and greedy requests
//! get.

mod acting;
mod events;
mod forged;
#[path = "../../examples/made_up/mod.rs"]
mod made_up;
mod screens;
mod served;
mod signing_in;
mod slow;
mod tls;
