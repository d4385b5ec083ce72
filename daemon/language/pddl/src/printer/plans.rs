//! Printing of plans, in the format of the planning competitions.

use std::fmt;

use super::layout::PrintLayout;
use super::terms::write;
use crate::tree::{Plan, PlanStep};

fn call(step: &PlanStep) -> PrintLayout<'_> {
    PrintLayout::headed(step.action.spelled(), step.arguments.iter().map(PrintLayout::name))
}

impl fmt::Display for PlanStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(time) = self.time {
            write!(f, "{time}: ")?;
        }
        write(&call(self), f)?;
        match self.duration {
            Some(duration) => write!(f, " [{duration}]"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for step in &self.steps {
            writeln!(f, "{step}")?;
        }
        match self.cost {
            Some(cost) => writeln!(f, "; cost = {cost}"),
            None => Ok(()),
        }
    }
}
