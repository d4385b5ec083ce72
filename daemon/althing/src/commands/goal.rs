//! `althing goal`: asks a running ecosystem for a goal, and follows it to its end.

use std::process::ExitCode;

use acl::ConversationId;
use acl::content::Keep;
use keyboard::{Said, Wish};

use crate::cli::{GoalArgs, WishArgs};
use crate::commands::client;
use crate::commands::speaking::{self, Interrupt, Manner};
use crate::config::{Ecosystem, not_in_parentheses, wish_for};

/// Asks for a goal or cancels one.
pub(super) fn run(args: &GoalArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let said = match said(link.view.ecosystem.as_deref(), &args.wish) {
            Ok(said) => said,
            Err(problem) => return (link, super::wrong(&problem, json)),
        };
        let interrupt = match args.wish.cancel {
            Some(_) => Interrupt::Leave("it was asked to be given up".to_owned()),
            None => Interrupt::LeaveGoal(client::reach_words(&args.reach)),
        };
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
    let wish =
        match ecosystem {
            Some(ecosystem) => ecosystem.wish(asked)?,
            None if asked.trim_start().starts_with('(') => wish_for(asked),
            None => {
                return Err(not_in_parentheses(asked).unwrap_or_else(|| format!(
                "`{asked}` may be a goal of the ecosystem file, which is not known here; write \
                 the goal in PDDL, or name the file with --ecosystem FILE"
            )));
            }
        };
    let wish = readable(wish)?;
    // What is said here counts more than what the file says of the goal.
    let keep = if args.maintain { Keep::Maintain } else { wish.keep };
    let priority = args.priority.unwrap_or(wish.priority);
    let partition = args.partition.map_or(wish.partition, Into::into);
    Ok(Said::Wish(Wish { keep, priority, partition, ..wish }))
}

/// The wish, if its goal can be read.
pub(super) fn readable(wish: Wish) -> Result<Wish, String> {
    let Wish { goal, .. } = &wish;
    pddl::parse_condition(goal).into_result().map_err(|found| super::located(&found, goal))?;
    Ok(wish)
}
