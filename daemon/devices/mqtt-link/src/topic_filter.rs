//! Topics and filters of MQTT: validity (MQTT 3.1.1, section 4.7), and matching of topics with
//! filters.

/// Maximum length of a topic, in bytes; a longer one is rejected. MQTT sends the length in two
/// bytes.
const TOPIC_BYTES_MAX: usize = u16::MAX as usize;

/// Returns the reason why a filter cannot be subscribed to; `None` if it can.
///
/// The check is needed because one invalid filter would end the connection, or make the client
/// library drop all other filters of the same batch.
pub fn filter_problem(filter: &str) -> Option<String> {
    if let Some(problem) = text_problem(filter) {
        return Some(problem);
    }
    if filter.starts_with("$share/") || filter.starts_with("$queue/") {
        return Some(format!(
            "`{filter}` is a shared subscription: other clients would receive some of its messages"
        ));
    }
    let levels = filter.split('/').count();
    for (number, level) in filter.split('/').enumerate() {
        if level.contains('#') && (level != "#" || number + 1 != levels) {
            return Some(format!("`{filter}` is no topic: `#` may only be its whole last level"));
        }
        if level.contains('+') && level != "+" {
            return Some(format!("`{filter}` is no topic: `+` may only be a whole level"));
        }
    }
    None
}

/// Returns the reason why no text can be published to this topic; `None` if the topic is valid.
pub fn topic_problem(topic: &str) -> Option<String> {
    if let Some(problem) = text_problem(topic) {
        return Some(problem);
    }
    let has_wildcard = topic.contains(['+', '#']);
    has_wildcard.then(|| {
        format!("nothing can be published to `{topic}`: `+` and `#` are only for subscriptions")
    })
}

fn text_problem(topic: &str) -> Option<String> {
    if topic.is_empty() {
        return Some("a topic is empty".to_owned());
    }
    if topic.len() > TOPIC_BYTES_MAX {
        return Some(format!("a topic is longer than {TOPIC_BYTES_MAX} bytes"));
    }
    let has_control = topic.chars().any(char::is_control);
    has_control.then(|| format!("the topic `{}` has a control character", topic.escape_debug()))
}

/// Whether a filter has wildcards, and therefore stands for several topics.
pub(crate) fn is_pattern(filter: &str) -> bool {
    filter.contains(['+', '#'])
}

/// Whether a topic matches a filter: `+` matches any one level, and `#` at the end matches all
/// further levels. The broker's own topics (`$SYS/…`) match only filters that do not begin with a
/// wildcard.
pub fn matches_filter(filter: &str, topic: &str) -> bool {
    if topic.starts_with('$') && filter.starts_with(['+', '#']) {
        return false;
    }
    let (mut filter, mut topic) = (filter.split('/'), topic.split('/'));
    loop {
        match (filter.next(), topic.next()) {
            (Some("#"), _) | (None, None) => return true,
            (Some("+"), Some(_)) => (),
            (Some(one), Some(other)) if one == other => (),
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_match_as_mqtt_defines() {
        for (filter, topic, expected) in [
            ("a/+/config", "a/b/config", true),
            ("a/+/config", "a/b/c/config", false),
            ("a/#", "a/b/c", true),
            ("a/#", "a", true),
            ("a/b", "a/b", true),
            ("a/b", "a/b/c", false),
            ("a/b/c", "a/b", false),
            ("#", "a/b", true),
            ("#", "$SYS/broker/uptime", false),
            ("+/broker/uptime", "$SYS/broker/uptime", false),
            ("$SYS/#", "$SYS/broker/uptime", true),
        ] {
            assert_eq!(matches_filter(filter, topic), expected, "{filter} {topic}");
        }
    }

    #[test]
    fn a_bad_filter_has_its_reason() {
        let long = "x".repeat(70_000);
        for (filter, expected) in [
            ("lab/#/bad", "`#` may only be its whole last level"),
            ("lab/bad#", "`#` may only be its whole last level"),
            ("lab/a+b", "`+` may only be a whole level"),
            ("", "a topic is empty"),
            ("a\0b", "has a control character"),
            ("$share/group/a", "shared subscription"),
            (long.as_str(), "longer than 65535 bytes"),
        ] {
            let problem = filter_problem(filter).expect(filter);
            assert!(problem.contains(expected), "{problem}");
        }
        for filter in ["lab/+/t", "lab/#", "#", "/", "a//b", " ", "$SYS/x", "büro/t"] {
            assert_eq!(filter_problem(filter), None);
        }
        let problem = topic_problem("lab/+/set").unwrap_or_default();
        assert!(problem.contains("only for subscriptions"), "{problem}");
        assert_eq!(topic_problem("lab/x/set"), None);
    }
}
