//! The Domain Maintainer as its callers see it: an office is told things, and is looked at.

mod office;

mod composition;
mod conflicts;
mod names;
mod presence;

mod beliefs;
mod scopes;

mod reading;
mod remembering;
mod repeating;
mod requests;
mod unknown;

mod following;
mod order;

mod limits;
mod looking;
