//! Parses a line of the prompt: a verb of the command line, with the same arguments. A line that
//! begins with `(` is a goal, and so is a line of several words that begins with no verb.

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};

use crate::cli::{ActionArgs, FactArgs, ModeArg, ReplyArgs, WatchWords, WhoseArgs, WishArgs};

/// The text that the verb `help` prints.
const HELP: &str = "\
Ask    (GOAL)  goal GOAL|NAME [--maintain] [--priority N]
       act (ACTION)            one action: (move turtlebot-1 corridor office1)
       set [--retract] (FACT)  change the known facts
       mode MODE               centralized or decentralized
       cancel N                the goal or action [N]; #N: goal N of `goals`
       answer N TEXT           answer question N; `answer` alone: all open ones
Stop   stop [NAME ...]         everything, or agents and places
       release [ID ...]        end all stops, or these
Look   agents  domain  state  goals  mailbox [AGENT]
       watch [N|#N]            the messages, or those of one goal; watch --off
Else   help VERB  quit         Tab completes, Ctrl-D ends
";

#[derive(Debug, Parser)]
#[command(multicall = true, disable_help_subcommand = true, max_term_width = 80)]
struct PromptLine {
    #[command(subcommand)]
    verb: Verb,
}

/// The verbs of the prompt.
#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// Ask for a goal, or cancel one
    Goal(WishArgs),
    /// Ask for one action
    Act(ActionArgs),
    /// Change the known facts
    Set(FactArgs),
    /// Change the planning mode
    Mode {
        /// The planning mode from now on
        mode: ModeArg,
    },
    /// Cancel a goal or an action
    Cancel {
        /// Its number here, # and its number in `goals`, or its conversation
        id: String,
    },
    /// Answer an agent's question, or list the open ones
    Answer(ReplyArgs),
    /// Stop everything, or agents and places
    Stop {
        /// Agents and places; everything if none is named
        names: Vec<String>,
    },
    /// End stops: all that are in force, or these
    Release {
        /// Identifiers of the stops to end
        ids: Vec<String>,
    },
    /// Show the goals and the state of each
    Goals,
    /// Show the agents that are present
    Agents,
    /// Show what all agents can do together, as a PDDL domain
    Domain,
    /// Show the known facts
    State,
    /// Show how full mailboxes are
    Mailbox(WhoseArgs),
    /// Show the messages as they are sent
    Watch(WatchWords),
    /// List the verbs, or explain one
    Help {
        /// The verb to explain
        verb: Option<String>,
    },
    /// Leave the prompt
    #[command(alias = "exit")]
    Quit,
}

/// Returns the names of all verbs.
pub(super) fn names() -> Vec<String> {
    PromptLine::command().get_subcommands().map(|verb| verb.get_name().to_owned()).collect()
}

/// Returns the list of verbs or, if `verb` is given, the help of that verb.
pub(super) fn help(verb: Option<&str>) -> String {
    let mut line = PromptLine::command();
    // Subcommands inherit the width of the output only when the command is built.
    line.build();
    match verb.and_then(|verb| line.find_subcommand_mut(verb)) {
        Some(verb) => verb.render_help().to_string(),
        None => HELP.to_owned(),
    }
}

/// Parses a line; returns `Ok(None)` for an empty line or a comment.
///
/// # Errors
///
/// Returns an error message for the user if there is no such verb, or if the arguments of the verb
/// are wrong.
pub(super) fn read(line: &str) -> Result<Option<Verb>, String> {
    let mut words = words(line);
    if words.first().is_none_or(|first| first.starts_with('#')) {
        return Ok(None);
    }
    if words.first().is_some_and(|first| first.starts_with('(')) || is_phrase(&words) {
        words.insert(0, "goal".to_owned());
    }
    if words.first().is_some_and(|first| first == "goal") {
        join_goal(&mut words);
    }
    let verb = words.first().cloned().unwrap_or_default();
    let read = PromptLine::try_parse_from(words);
    read.map(|line| Some(line.verb)).map_err(|error| problem(&error, &verb))
}

/// Whether a line is a goal in words: several words, the first of which is no verb and resembles none.
fn is_phrase(words: &[String]) -> bool {
    let [first, _, ..] = words else { return false };
    let names = names();
    pddl::nearest(first, names.iter().map(String::as_str)).is_none() && first != "exit"
}

/// Joins the words of a goal behind `goal`, up to the first option, to one argument.
fn join_goal(words: &mut Vec<String>) {
    let end = words.iter().position(|word| word.starts_with("--")).unwrap_or(words.len());
    if end > 2 {
        let goal = words.drain(1..end).collect::<Vec<_>>().join(" ");
        words.insert(1, goal);
    }
}

/// Explains a mistake in a line of the prompt, without clap's remarks, which are about whole
/// command lines.
fn problem(error: &clap::Error, verb: &str) -> String {
    if error.kind() == ErrorKind::InvalidSubcommand {
        let names = names();
        return match pddl::nearest(verb, names.iter().map(String::as_str)) {
            Some(near) => format!("error: there is no verb `{verb}`; did you mean `{near}`?"),
            None => format!("error: there is no verb `{verb}`; `help` lists what there is"),
        };
    }
    let rendered = error.render().to_string();
    let said = rendered.split("\n\nUsage:").next().unwrap_or(&rendered).trim_end();
    let said = said.trim_end_matches("For more information, try '--help'.").trim_end();
    format!("{said}\n`help {verb}` says how it is written")
}

/// Splits a line into words at white space, except within parentheses or quotes.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut rest = line.trim_start();
    while let Some(first) = rest.chars().next() {
        let (word, length) = match first {
            '(' => {
                let length = expression(rest);
                (&rest[..length], length)
            }
            '"' | '\'' => match rest[1..].find(first) {
                Some(length) => (&rest[1..=length], length + 2),
                None => (&rest[1..], rest.len()),
            },
            _ => {
                let length = rest.find(char::is_whitespace).unwrap_or(rest.len());
                (&rest[..length], length)
            }
        };
        words.push(word.to_owned());
        rest = rest[length..].trim_start();
    }
    words
}

/// Returns the length of the PDDL expression at the start of `text`; if it is not closed, the
/// length of `text`.
fn expression(text: &str) -> usize {
    let mut depth = 0_usize;
    for (at, character) in text.char_indices() {
        match character {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            _ => continue,
        }
        if depth == 0 {
            return at + 1;
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(line: &str, expected: &[&str]) {
        assert_eq!(words(line), expected);
    }

    #[test]
    fn an_expression_is_one_word() {
        check("", &[]);
        check("  agents ", &["agents"]);
        check("act (move r a b)", &["act", "(move r a b)"]);
        check("(and (a) (b)) --maintain", &["(and (a) (b))", "--maintain"]);
        check("(and (a)", &["(and (a)"]);
        check("answer 1 it's fine", &["answer", "1", "it's", "fine"]);
        check("answer 1 'it is' \"so", &["answer", "1", "it is", "so"]);
        check("set (= (f a) 3)(b)", &["set", "(= (f a) 3)", "(b)"]);
    }

    #[test]
    fn a_line_is_a_verb_or_a_goal() {
        let is_goal = |line: &str| matches!(read(line), Ok(Some(Verb::Goal(_))));
        assert!(is_goal("(known-temperature office1)"));
        assert!(is_goal("goal temperatures --maintain"));
        assert!(matches!(read("mode centralized"), Ok(Some(Verb::Mode { .. }))));
        let goal_of = |line: &str| match read(line) {
            Ok(Some(Verb::Goal(wish))) => wish.goal,
            _ => None,
        };
        let said = "temperature of office1 known";
        assert_eq!(goal_of(said).as_deref(), Some(said));
        assert_eq!(goal_of("goal temperature of office1 known --maintain").as_deref(), Some(said));
        assert_eq!(goal_of("goal (a) and (b)").as_deref(), Some("(a) and (b)"));
        assert_eq!(goal_of("(a) and (b) --maintain").as_deref(), Some("(a) and (b)"));
        assert!(matches!(read(" "), Ok(None)));
        assert!(matches!(read("# a remark"), Ok(None)));
    }

    #[test]
    fn a_slip_is_answered_with_the_likely_verb() {
        let problem = |line| read(line).expect_err("it cannot be read");
        assert_eq!(problem("agnets"), "error: there is no verb `agnets`; did you mean `agents`?");
        assert_eq!(problem("foo"), "error: there is no verb `foo`; `help` lists what there is");
        let expected = expect_test::expect![[r#"
            error: unexpected argument 'office1' found
            `help act` says how it is written"#]];
        expected.assert_eq(&problem("act move office1"));
        let expected = expect_test::expect![[r#"
            error: invalid value 'centralised' for '<MODE>'
              [possible values: centralized, decentralized]

              tip: a similar value exists: 'centralized'
            `help mode` says how it is written"#]];
        expected.assert_eq(&problem("mode centralised"));
    }

    #[test]
    fn help_fits_a_terminal_and_names_every_verb() {
        for name in names() {
            assert!(HELP.contains(&name), "{name}");
            assert!(help(Some(&name)).lines().all(|line| line.chars().count() <= 80), "{name}");
        }
        assert!(HELP.lines().all(|line| line.chars().count() <= 80));
    }
}
