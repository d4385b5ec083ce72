//! External engines as users meet them: real Fast Downward where it is installed, and stand-ins that
//! answer, hang and lie as engines do.

mod conformance;
mod differential;
mod fast_downward;
mod features;
mod following;
mod leaving;
mod metric_ff;
mod support;
