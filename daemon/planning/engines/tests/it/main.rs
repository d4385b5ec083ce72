//! Tests of external engines from a user's point of view: the real Fast Downward if it is
//! installed, and stand-ins that answer, hang and return wrong results.

mod conformance;
mod differential;
mod fast_downward;
mod features;
mod following;
mod leaving;
mod metric_ff;
mod support;
