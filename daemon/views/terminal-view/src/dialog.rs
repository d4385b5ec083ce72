//! Dialogs: what a person is asked before an `althing` command runs.

use crate::input::ViewAct;
use crate::sheet::AskedQuestion;
use crate::text_field::TextField;

/// The command that a dialog runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum DialogKind {
    Goal { is_kept: bool },
    Action,
    Stop,
    Release,
    Cancel { conversation: String },
    Answer { question: String },
    Admit { question: String },
}

/// A question to the person at the terminal. It has no `Debug`, because the answer may be secret.
#[derive(Clone)]
pub(crate) struct Dialog {
    /// The command that it runs.
    pub(crate) kind: DialogKind,
    /// What is asked.
    pub(crate) asks: String,
    /// What Enter does at last.
    enter: &'static str,
    /// What is typed; `None` if there is only yes or no.
    pub(crate) field: Option<TextField>,
    /// The dry run that was asked for last, as arguments of its command: the next Enter asks for
    /// the same goal. `None` if none was.
    tried: Option<Vec<String>>,
}

impl Dialog {
    /// Asks for a goal.
    pub(crate) fn goal() -> Self {
        Self {
            kind: DialogKind::Goal { is_kept: false },
            asks: "What is wanted? A goal in PDDL, such as (known-temperature office1), or the \
                   name of one in the ecosystem file."
                .to_owned(),
            enter: "asks for it",
            field: Some(TextField::default()),
            tried: None,
        }
    }

    /// Asks for an action.
    pub(crate) fn action() -> Self {
        Self {
            kind: DialogKind::Action,
            asks: "Which action? Such as (move turtlebot-1 corridor office1).".to_owned(),
            enter: "asks for it",
            field: Some(TextField::default()),
            tried: None,
        }
    }

    /// Asks before a stop; the selected agent is offered by Tab.
    pub(crate) fn stop() -> Self {
        Self {
            kind: DialogKind::Stop,
            asks: "Stop everything? Or only these agents and places:".to_owned(),
            enter: "stops",
            field: Some(TextField::default()),
            tried: None,
        }
    }

    /// Asks before all stops are released.
    pub(crate) fn release() -> Self {
        Self {
            kind: DialogKind::Release,
            asks: "Release all stops that are in force? What was stopped may move again."
                .to_owned(),
            enter: "releases",
            field: None,
            tried: None,
        }
    }

    /// Asks before a goal is cancelled.
    pub(crate) fn cancel(conversation: &str, goal: &str) -> Self {
        Self {
            kind: DialogKind::Cancel { conversation: conversation.to_owned() },
            asks: format!("Cancel the goal {goal}?"),
            enter: "cancels it",
            field: None,
            tried: None,
        }
    }

    /// Asks for the answer to a question; `Err` says why it cannot be answered yet.
    pub(crate) fn answer(question: &AskedQuestion) -> Result<Self, &'static str> {
        let id = question.id.clone().ok_or(NO_NUMBER)?;
        let hidden = if question.is_secret { " (typed hidden)" } else { "" };
        Ok(Self {
            kind: DialogKind::Answer { question: id },
            asks: format!("{} asks: {}{hidden}", question.from, question.text),
            enter: "answers",
            field: Some(if question.is_secret {
                TextField::secret()
            } else {
                TextField::default()
            }),
            tried: None,
        })
    }

    /// Asks before a question is answered with yes; `Err` says why it cannot be answered yet.
    pub(crate) fn admit(question: &AskedQuestion) -> Result<Self, &'static str> {
        let id = question.id.clone().ok_or(NO_NUMBER)?;
        Ok(Self {
            kind: DialogKind::Admit { question: id },
            asks: format!("{} asks: {}", question.from, question.text),
            enter: "answers yes",
            field: None,
            tried: None,
        })
    }

    /// Chooses whether the goal is kept; returns whether this dialog has that choice.
    pub(crate) fn toggle(&mut self) -> bool {
        match &mut self.kind {
            DialogKind::Goal { is_kept } => {
                *is_kept = !*is_kept;
                true
            }
            _ => false,
        }
    }

    /// Returns the command that plans for the goal and asks for nothing; `None` in other dialogs.
    fn dry_run(&self) -> Option<Result<Vec<String>, &'static str>> {
        let DialogKind::Goal { is_kept } = self.kind else { return None };
        let typed = self.field.as_ref().map(TextField::text).unwrap_or_default();
        let options = ["--dry-run", "--maintain"].into_iter().take(1 + usize::from(is_kept));
        Some(word(&typed).map(|goal| {
            let words = std::iter::once("goal").chain(options).chain([goal]);
            words.map(str::to_owned).collect()
        }))
    }

    /// Whether `title` names the dry run of what is typed now.
    pub(crate) fn has_tried(&self, title: &str) -> bool {
        let Some(tried) = self.tried.as_ref() else { return false };
        let is_same = self.dry_run().is_some_and(|now| now.as_ref() == Ok(tried));
        is_same && title.strip_prefix("althing ").unwrap_or(title) == tried.join(" ")
    }

    /// Makes the next Enter plan anew.
    pub(crate) fn forget_dry_run(&mut self) {
        self.tried = None;
    }

    /// Returns what Enter asks for: of a goal first the dry run, and, if that was asked for already,
    /// the goal; `Err` says what is missing.
    pub(crate) fn press_enter(&mut self) -> Result<ViewAct, &'static str> {
        let dry_run = self.dry_run().transpose()?;
        if dry_run.is_none() || self.tried == dry_run {
            return self.act();
        }
        self.tried.clone_from(&dry_run);
        Ok(ViewAct::Run { arguments: dry_run.unwrap_or_default(), input: None })
    }

    /// Says what Enter does now.
    pub(crate) fn enter_does(&self) -> &'static str {
        if self.is_last() { self.enter } else { "shows the plan, and asks for nothing yet" }
    }

    /// Whether Enter does what the dialog is for, and not only a dry run.
    pub(crate) fn is_last(&self) -> bool {
        self.dry_run().is_none_or(|now| now.is_ok_and(|now| self.tried.as_ref() == Some(&now)))
    }

    /// Returns the act of the dialog; `Err` says what is missing.
    pub(crate) fn act(&self) -> Result<ViewAct, &'static str> {
        let typed = self.field.as_ref().map(TextField::text).unwrap_or_default();
        let words = |words: &[&str]| Ok(words.iter().map(|&word| word.to_owned()).collect());
        let arguments: Result<Vec<String>, &'static str> = match &self.kind {
            DialogKind::Goal { is_kept: true } => words(&["goal", "--maintain", word(&typed)?]),
            DialogKind::Goal { is_kept: false } => words(&["goal", word(&typed)?]),
            DialogKind::Action => words(&["act", word(&typed)?]),
            DialogKind::Stop => {
                let names: Result<Vec<&str>, _> = typed.split_whitespace().map(word).collect();
                words(&[vec!["stop"], names?].concat())
            }
            DialogKind::Release => words(&["stop", "--release"]),
            DialogKind::Cancel { conversation } => {
                words(&["goal", "--cancel", word(conversation)?])
            }
            DialogKind::Answer { question } | DialogKind::Admit { question } => {
                words(&["answer", word(question)?])
            }
        };
        let input = match &self.kind {
            DialogKind::Answer { .. } => Some(typed),
            DialogKind::Admit { .. } => Some("yes".to_owned()),
            _ => None,
        };
        Ok(ViewAct::Run { arguments: arguments?, input })
    }
}

const NO_NUMBER: &str = "the keyboard has not said the number of this question yet: try again";

/// Returns a text that can be an argument of a command: not empty, and no option.
pub(crate) fn word(text: &str) -> Result<&str, &'static str> {
    match text.trim() {
        "" => Err("type it first, or leave with Esc"),
        text if text.starts_with('-') => Err("this begins with `-`, so it would be an option"),
        text => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(dialog: Result<Dialog, &'static str>, typed: &str) -> Result<(String, String), String> {
        let mut dialog = dialog?;
        if let Some(field) = &mut dialog.field {
            field.insert(typed);
        }
        match dialog.act()? {
            ViewAct::Run { arguments, input } => {
                Ok((arguments.join("|"), input.unwrap_or_default()))
            }
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn dialogs_run_commands() {
        let check = |dialog: Dialog, typed: &str, expected: Result<&str, &str>| {
            let found = run(Ok(dialog), typed).map(|(arguments, _)| arguments);
            assert_eq!(found.as_deref().map_err(String::as_str), expected);
        };
        check(Dialog::goal(), " (a b) ", Ok("goal|(a b)"));
        let mut kept = Dialog::goal();
        assert!(kept.toggle());
        check(kept, "temperatures", Ok("goal|--maintain|temperatures"));
        check(Dialog::goal(), "", Err("type it first, or leave with Esc"));
        check(Dialog::action(), "(move r a b)", Ok("act|(move r a b)"));
        check(Dialog::stop(), "", Ok("stop"));
        check(Dialog::stop(), "office1  robot-1", Ok("stop|office1|robot-1"));
        let option = Err("this begins with `-`, so it would be an option");
        check(Dialog::stop(), "office1 --release", option);
        check(Dialog::release(), "", Ok("stop|--release"));
        check(Dialog::cancel("c-1", "(a)"), "", Ok("goal|--cancel|c-1"));
        check(Dialog::cancel("--help", "(a)"), "", option);
    }

    #[test]
    fn a_goal_is_tried_before_it_is_asked_for() {
        let mut dialog = Dialog::goal();
        assert_eq!(dialog.press_enter(), Err("type it first, or leave with Esc"));
        dialog.field.iter_mut().for_each(|field| field.insert("(a b)"));
        let mut entered = |change: fn(&mut Dialog)| {
            change(&mut dialog);
            match dialog.press_enter().expect("it is typed") {
                ViewAct::Run { arguments, .. } => arguments.join("|"),
                other => format!("{other:?}"),
            }
        };
        assert_eq!(entered(|_| ()), "goal|--dry-run|(a b)");
        assert_eq!(entered(|_| ()), "goal|(a b)");
        assert_eq!(
            entered(|it| {
                it.toggle();
            }),
            "goal|--dry-run|--maintain|(a b)"
        );
        assert_eq!(entered(|it| it.field.iter_mut().for_each(|it| it.set("x"))), {
            "goal|--dry-run|--maintain|x"
        });
        assert_eq!(entered(|_| ()), "goal|--maintain|x");
        assert!(dialog.has_tried("althing goal --dry-run --maintain x"));
        dialog.field.iter_mut().for_each(|field| field.insert("y"));
        assert!(!dialog.has_tried("althing goal --dry-run --maintain x"));
    }

    #[test]
    fn answers_are_no_arguments() {
        let mut question = AskedQuestion {
            id: Some("hall/1".to_owned()),
            from: "door".to_owned(),
            text: "PIN?".to_owned(),
            is_secret: true,
        };
        let answer = Dialog::answer(&question);
        let (arguments, input) = run(answer, "2718").expect("an answer");
        assert_eq!((arguments.as_str(), input.as_str()), ("answer|hall/1", "2718"));
        let admitted = run(Dialog::admit(&question), "").expect("an answer");
        assert_eq!(admitted, ("answer|hall/1".to_owned(), "yes".to_owned()));
        let mut dialog = Dialog::answer(&question).unwrap_or_else(|_| unreachable!());
        dialog.field.iter_mut().for_each(|field| field.insert("2718"));
        let act = dialog.act().expect("an act");
        assert!(!format!("{act:?}").contains("2718"), "{act:?}");
        question.id = None;
        assert!(Dialog::answer(&question).is_err());
    }
}
