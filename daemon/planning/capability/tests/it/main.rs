//! Tests of the Domain Maintainer through its public interface, with a small office as example.

mod office;

mod composition;
mod conflicts;
mod joint;
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
