//! Texts for people: steps as sentences, and texts cut to a length.

/// A ground action: `(ACTION AGENT ARGUMENT*)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct GroundStep {
    pub(crate) action: String,
    /// The arguments; the first one is the acting agent.
    pub(crate) arguments: Vec<String>,
}

impl GroundStep {
    /// Parses a ground action. A text that is not PDDL becomes an action without arguments.
    pub(crate) fn parse(text: &str) -> GroundStep {
        match pddl::parse_step(text).value {
            Some(step) => GroundStep::of(&step),
            None => GroundStep { action: one_line(text), arguments: Vec::new() },
        }
    }

    pub(crate) fn of(step: &pddl::PlanStep) -> GroundStep {
        GroundStep {
            action: step.action.as_str().to_owned(),
            arguments: step.arguments.iter().map(|name| name.as_str().to_owned()).collect(),
        }
    }

    /// Returns the bytes that a step takes, roughly, with the report about it.
    pub(crate) fn bytes(&self) -> usize {
        const WITHOUT_TEXT: usize = 300;
        let texts = self.arguments.iter().map(|argument| argument.len() + size_of::<String>());
        WITHOUT_TEXT + self.action.len() + texts.sum::<usize>()
    }

    /// Returns the ground action as PDDL.
    pub(crate) fn to_pddl(&self) -> String {
        let mut text = format!("({}", self.action);
        for argument in &self.arguments {
            text.push(' ');
            text.push_str(argument);
        }
        text.push(')');
        text
    }

    /// Returns the action as a sentence. `place` is the place that the agent moves to, if the action
    /// moves it.
    pub(crate) fn sentence(&self, place: Option<&str>) -> String {
        let Some((agent, arguments)) = self.arguments.split_first() else {
            return self.action.clone();
        };
        let mut words = self.action.split(['-', '_']).filter(|word| !word.is_empty());
        let verb = third_person(words.next().unwrap_or("act"));
        let rest: String = words.map(|word| format!(" {word}")).collect();
        match place {
            Some(place) => format!("{agent} {verb}{rest} to {place}"),
            None if arguments.is_empty() => format!("{agent} {verb}{rest}"),
            None => format!("{agent} {verb}{rest}: {}", arguments.join(", ")),
        }
    }
}

/// Returns the third person of a verb: `moves`, `reaches`, `carries`.
fn third_person(verb: &str) -> String {
    let is_vowel = |c: char| "aeiou".contains(c);
    let mut before_last = verb.chars().rev().skip(1);
    if let Some(stem) = verb.strip_suffix('y')
        && before_last.next().is_some_and(|c| !is_vowel(c))
    {
        return format!("{stem}ies");
    }
    let hisses = ["s", "x", "z", "ch", "sh", "o"].iter().any(|end| verb.ends_with(end));
    format!("{verb}{}", if hisses { "es" } else { "s" })
}

/// Returns a text with all white space as single spaces.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns a text on one line, of at most `bytes_max` bytes.
pub(crate) fn short(text: &str, bytes_max: usize) -> String {
    // A long text is cut before its white space is replaced, so that the work is bounded, too.
    cut(&one_line(&cut(text, bytes_max.saturating_mul(2))), bytes_max)
}

/// Cuts a text to at most `bytes_max` bytes; `…` marks the cut.
pub(crate) fn cut(text: &str, bytes_max: usize) -> String {
    const MARK: char = '…';
    if text.len() <= bytes_max {
        return text.to_owned();
    }
    let mut end = bytes_max.saturating_sub(MARK.len_utf8());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut cut = String::with_capacity(end + MARK.len_utf8());
    cut.push_str(&text[..end]);
    cut.push(MARK);
    cut
}

/// Returns a number with its noun: `1 step`, `3 steps`.
pub(crate) fn plural(count: u64, noun: &str) -> String {
    match count {
        1 => format!("1 {noun}"),
        _ => format!("{count} {noun}s"),
    }
}

/// Returns a number and its noun with a verb: `1 goal waits`, `3 goals wait`.
pub(crate) fn plural_verb(count: u64, noun: &str, verb: &str) -> String {
    match count {
        1 => format!("1 {noun} {}", third_person(verb)),
        _ => format!("{count} {noun}s {verb}"),
    }
}

/// Returns a number without needless digits.
pub(crate) fn number(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    format!("{rounded}")
}

/// Returns a duration in few characters: `340 ms`, `12 s`, `5 min`, `3 h`, `2 days`.
pub(crate) fn duration(milliseconds: u64) -> String {
    match milliseconds {
        0..1_000 => format!("{milliseconds} ms"),
        1_000..120_000 => format!("{} s", milliseconds / 1_000),
        120_000..7_200_000 => format!("{} min", milliseconds / 60_000),
        7_200_000..172_800_000 => format!("{} h", milliseconds / 3_600_000),
        _ => format!("{} days", milliseconds / 86_400_000),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_a_sentence() {
        let said = |text: &str, place| GroundStep::parse(text).sentence(place);
        let moves = "(move turtlebot-1 corridor office1)";
        assert_eq!(said(moves, Some("office1")), "turtlebot-1 moves to office1");
        assert_eq!(
            said("(report-temperature ir-1 turtlebot-1 office1)", None),
            "ir-1 reports temperature: turtlebot-1, office1"
        );
        assert_eq!(said("(recharge r1)", None), "r1 recharges");
        assert_eq!(said("nonsense )(", None), "nonsense )(");
        assert_eq!(GroundStep::parse(moves).to_pddl(), moves);
    }

    #[test]
    fn verbs_get_their_ending() {
        for (verb, third) in [
            ("move", "moves"),
            ("watch", "watches"),
            ("carry", "carries"),
            ("play", "plays"),
            ("go", "goes"),
            ("y", "ys"),
        ] {
            assert_eq!(third_person(verb), third);
        }
    }

    #[test]
    fn texts_are_cut_between_characters() {
        assert_eq!(cut("äöü", 6), "äöü");
        assert_eq!(cut("äöüß", 6), "ä…");
        assert_eq!(cut("abc", 0), "…");
        assert_eq!(short("a \n\t b", 9), "a b");
    }

    #[test]
    fn durations_are_short() {
        let all = [340, 12_000, 300_000, 10_800_000, 172_800_000].map(duration);
        assert_eq!(all, ["340 ms", "12 s", "5 min", "3 h", "2 days"]);
    }
}
