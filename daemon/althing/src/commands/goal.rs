//! `althing goal`: asks a running ecosystem for a goal, and follows it to its end.

use std::process::ExitCode;

use acl::ConversationId;
use acl::content::Keep;
use keyboard::{Said, Wish};

use crate::cli::{GoalArgs, WishArgs};
use crate::commands::client;
use crate::commands::speaking::{self, Interrupt, Manner};
use crate::config::Ecosystem;

/// Asks for a goal or cancels one.
pub(super) fn run(args: &GoalArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let said = match said(link.view.ecosystem.as_deref(), &args.wish) {
            Ok(said) => said,
            Err(problem) => return (link, super::wrong(&problem, json)),
        };
        let advice = "the goal goes on without you; give it up with: althing goal --cancel ID";
        let interrupt = Interrupt::Leave(advice);
        let manner = Manner { to: Some("plan-requester"), json, interrupt };
        let code = speaking::say(&link, said, manner).await;
        (link, code)
    })
}

/// What is to be said, once the goal is found and can be read.
pub(crate) fn said(ecosystem: Option<&Ecosystem>, args: &WishArgs) -> Result<Said, String> {
    if let Some(id) = &args.cancel {
        return Ok(Said::Cancel(ConversationId::new(id)));
    }
    let asked = args.goal.as_deref().unwrap_or_default();
    let goal = match ecosystem {
        Some(ecosystem) => ecosystem.goal_text(asked)?.to_owned(),
        None if asked.trim_start().starts_with('(') => asked.to_owned(),
        None => {
            return Err(format!(
                "`{asked}` may be a goal of the ecosystem file, which is not known here; write \
                 the goal in PDDL, or name the file with --ecosystem FILE"
            ));
        }
    };
    pddl::parse_condition(&goal).into_result().map_err(|found| super::located(&found, &goal))?;
    let keep = if args.maintain { Keep::Maintain } else { Keep::Achieve };
    let partition = args.partition.into();
    Ok(Said::Wish(Wish { goal, keep, priority: args.priority, partition }))
}
