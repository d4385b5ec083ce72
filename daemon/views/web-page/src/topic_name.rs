//! The topics to which a page subscribes: parts of what is to be seen, each sent as rows.

use std::fmt;

use acl::{AgentId, ConversationId};

/// Maximum number of topics of one stream: more than any page shows.
const TOPICS_MAX: usize = 24;

/// Maximum length of the list of topics, in bytes.
const LIST_BYTES_MAX: usize = 4 << 10;

/// Maximum length of the name of a conversation in a topic, in bytes.
const CONVERSATION_BYTES_MAX: usize = 256;

/// A topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum TopicName {
    Overview,
    Goals,
    Agents,
    Facts,
    Floor,
    Questions,
    Activity,
    Conversations,
    Daemons,
    Inbox,
    Stops,
    Goal(ConversationId),
    Agent(AgentId),
    /// What the screen of an agent shows.
    Robot(AgentId),
    Conversation(ConversationId),
}

/// The topics that are about everything of a kind, with their names.
const LISTS: &[(&str, TopicName)] = &[
    ("overview", TopicName::Overview),
    ("goals", TopicName::Goals),
    ("agents", TopicName::Agents),
    ("facts", TopicName::Facts),
    ("floor", TopicName::Floor),
    ("questions", TopicName::Questions),
    ("activity", TopicName::Activity),
    ("conversations", TopicName::Conversations),
    ("daemons", TopicName::Daemons),
    ("inbox", TopicName::Inbox),
    ("stops", TopicName::Stops),
];

impl fmt::Display for TopicName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TopicName::Goal(goal) => write!(f, "goal:{}", goal.as_str()),
            TopicName::Agent(agent) => write!(f, "agent:{agent}"),
            TopicName::Robot(agent) => write!(f, "robot:{agent}"),
            TopicName::Conversation(of) => write!(f, "conversation:{}", of.as_str()),
            list => {
                let named = LISTS.iter().find(|(_, topic)| topic == list);
                f.write_str(named.map_or("", |(name, _)| name))
            }
        }
    }
}

impl TopicName {
    /// Whether the topic is about one thing, and not about all of a kind.
    pub(crate) fn is_thing(&self) -> bool {
        !LISTS.iter().any(|(_, list)| list == self)
    }

    /// Parses one topic.
    fn parse(text: &str) -> Option<TopicName> {
        if let Some((_, topic)) = LISTS.iter().find(|(name, _)| *name == text) {
            return Some(topic.clone());
        }
        let (kind, name) = text.split_once(':')?;
        match kind {
            "goal" => Some(TopicName::Goal(conversation(name)?)),
            "agent" => Some(TopicName::Agent(AgentId::new(name).ok()?)),
            "robot" => Some(TopicName::Robot(AgentId::new(name).ok()?)),
            "conversation" => Some(TopicName::Conversation(conversation(name)?)),
            _ => None,
        }
    }

    /// Parses the topics of a stream, which are separated by commas.
    ///
    /// # Errors
    ///
    /// Returns a sentence for a person if one of them is unknown, or if they are too many.
    pub(crate) fn list(text: &str) -> Result<Vec<TopicName>, String> {
        if text.len() > LIST_BYTES_MAX {
            return Err(format!("the topics are longer than {LIST_BYTES_MAX} bytes"));
        }
        let mut topics: Vec<TopicName> = Vec::new();
        for part in text.split(',').filter(|part| !part.is_empty()) {
            let topic = TopicName::parse(part).ok_or_else(|| {
                let names: Vec<_> = LISTS.iter().map(|(name, _)| *name).collect();
                format!(
                    "there is no topic `{}`; there are {}, and `goal:ID`, `agent:NAME`, `robot:NAME`, \
                     `conversation:ID`",
                    part.escape_debug(),
                    names.join(", "),
                )
            })?;
            if !topics.contains(&topic) {
                topics.push(topic);
            }
        }
        if topics.is_empty() || topics.len() > TOPICS_MAX {
            return Err(format!("name 1 to {TOPICS_MAX} topics, as in `?topics=overview,goals`"));
        }
        Ok(topics)
    }
}

/// Returns the conversation of a name that comes from outside; `None` if the name would break the
/// line of the event that carries it.
pub(crate) fn conversation(name: &str) -> Option<ConversationId> {
    let is_plain = !name.is_empty()
        && name.len() <= CONVERSATION_BYTES_MAX
        && !name.chars().any(char::is_control);
    is_plain.then(|| ConversationId::new(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_read_as_they_are_written() {
        let text = "overview,goals,agents,facts,floor,questions,activity,conversations,daemons,\
                    inbox,stops,goal:g1,agent:lamp,robot:tb,conversation:c:1";
        let topics = TopicName::list(text).expect("all are known");
        let written: Vec<_> = topics.iter().map(ToString::to_string).collect();
        assert_eq!(written.join(","), text);
    }

    #[test]
    fn wrong_topics_are_refused() {
        let many = (0..30).map(|number| format!("goal:{number}")).collect::<Vec<_>>().join(",");
        let long = "x".repeat(5_000);
        for text in ["", ",", "nothing", "agent:No Name", "goal:", "goal:a\nb", &many, &long] {
            assert!(TopicName::list(text).is_err(), "{text}");
        }
    }
}
