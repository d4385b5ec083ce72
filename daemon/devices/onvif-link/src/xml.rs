//! A small tree of XML, read tolerantly and within bounds.
//!
//! Elements are found by their local names, because cameras choose prefixes freely and a few of
//! them use wrong namespaces.

use quick_xml::XmlVersion;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesStart, Event};
use quick_xml::name::ResolveResult;
use quick_xml::reader::NsReader;

/// Maximum depth of elements; a deeper document is refused. Answers of cameras have about ten
/// levels.
const DEPTH_MAX: usize = 64;

/// Maximum number of elements; a longer document is refused. A camera with 256 presets answers with
/// about 2,000 elements.
const ELEMENTS_MAX: usize = 50_000;

/// An element of a document.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Element {
    /// Local name of the element, without a prefix.
    pub(crate) name: String,
    /// Namespace of the element; empty if its prefix is not declared.
    pub(crate) namespace: String,
    attributes: Vec<(String, String)>,
    text: String,
    pub(crate) children: Vec<Element>,
}

impl Element {
    /// Reads a document. The error is a text about the document's mistake.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Element, String> {
        let text = String::from_utf8_lossy(bytes);
        let mut reader = NsReader::from_str(text.trim_start_matches('\u{feff}').trim());
        let (mut open, mut count) = (Vec::<Element>::new(), 0_usize);
        loop {
            let (namespace, event) =
                reader.read_resolved_event().map_err(|error| format!("it is no XML: {error}"))?;
            let namespace = match namespace {
                ResolveResult::Bound(namespace) => namespace.as_ref().to_owned(),
                _ => String::new(),
            };
            match event {
                Event::Start(start) => {
                    count += 1;
                    if open.len() >= DEPTH_MAX || count > ELEMENTS_MAX {
                        return Err("it has too many elements".to_owned());
                    }
                    open.push(element(&start, namespace));
                }
                Event::Empty(start) => {
                    count += 1;
                    if count > ELEMENTS_MAX {
                        return Err("it has too many elements".to_owned());
                    }
                    if let Some(root) = close(&mut open, element(&start, namespace)) {
                        return Ok(root);
                    }
                }
                Event::End(_) => {
                    let Some(closed) = open.pop() else {
                        return Err("it ends an element that it has not begun".to_owned());
                    };
                    if let Some(root) = close(&mut open, closed) {
                        return Ok(root);
                    }
                }
                Event::Eof if open.is_empty() => return Err("it is no XML".to_owned()),
                Event::Eof => return Err("it breaks off in the middle".to_owned()),
                other => add_text(open.last_mut(), &other),
            }
        }
    }

    /// Returns the first child with this local name.
    pub(crate) fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.name == name)
    }

    /// Returns the first element at a path of local names below this element.
    pub(crate) fn at(&self, path: &[&str]) -> Option<&Element> {
        path.iter().try_fold(self, |element, name| element.child(name))
    }

    /// Returns all children with this local name.
    pub(crate) fn all<'e>(&'e self, name: &'e str) -> impl Iterator<Item = &'e Element> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// Returns the first element with this local name at any depth, in the order of the document.
    pub(crate) fn find(&self, name: &str) -> Option<&Element> {
        self.children
            .iter()
            .find_map(|child| if child.name == name { Some(child) } else { child.find(name) })
    }

    /// Returns the value of an attribute by its local name.
    pub(crate) fn attribute(&self, name: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(known, _)| known == name);
        found.map(|(_, value)| value.as_str())
    }

    /// Returns the text of the element itself, without white space around it.
    pub(crate) fn text(&self) -> &str {
        self.text.trim()
    }

    /// Returns the text at a path of local names; `None` if there is no text.
    pub(crate) fn text_at(&self, path: &[&str]) -> Option<&str> {
        self.at(path).map(Element::text).filter(|text| !text.is_empty())
    }
}

fn element(start: &BytesStart<'_>, namespace: String) -> Element {
    let name = start.local_name().as_ref().to_owned();
    let mut attributes = Vec::new();
    // An attribute that cannot be read is left out; the element may be complete without it.
    for attribute in start.attributes().with_checks(false).flatten() {
        let key = attribute.key.local_name().as_ref().to_owned();
        let value = match attribute.normalized_value(XmlVersion::Implicit1_0) {
            Ok(value) => value.into_owned(),
            Err(_) => attribute.value.into_owned(),
        };
        attributes.push((key, value));
    }
    Element { name, namespace, attributes, ..Element::default() }
}

/// Adds a closed element to the one that contains it. Returns the element if none contains it.
fn close(open: &mut [Element], closed: Element) -> Option<Element> {
    match open.last_mut() {
        Some(parent) => {
            parent.children.push(closed);
            None
        }
        None => Some(closed),
    }
}

fn add_text(element: Option<&mut Element>, event: &Event<'_>) {
    let Some(element) = element else { return };
    match event {
        Event::Text(text) => element.text += text,
        Event::CData(text) => element.text += text,
        Event::GeneralRef(reference) => match reference.resolve_char_ref() {
            Ok(Some(symbol)) => element.text.push(symbol),
            _ => {
                element.text += resolve_predefined_entity(reference).unwrap_or_default();
            }
        },
        _ => (),
    }
}

/// Returns a text as it is written inside an element or an attribute, without control characters.
pub(crate) fn escape(text: &str) -> String {
    let legal = text.chars().filter(|symbol| !symbol.is_control()).collect::<String>();
    quick_xml::escape::escape(legal).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_found_by_their_local_names() {
        let text = "\u{feff}<?xml version='1.0'?>\n<!-- x --><a:Root xmlns:a='urn:a'>\
                    <a:Preset token='1&amp;2'><b:Name> T&#252;r &lt;1&gt; </b:Name></a:Preset>\
                    <Preset/></a:Root>";
        let root = Element::parse(text.as_bytes()).expect("XML");
        assert_eq!((root.name.as_str(), root.namespace.as_str()), ("Root", "urn:a"));
        assert_eq!(root.all("Preset").count(), 2);
        let preset = root.child("Preset").expect("a preset");
        assert_eq!(preset.attribute("token"), Some("1&2"));
        assert_eq!(root.text_at(&["Preset", "Name"]), Some("Tür <1>"));
        assert_eq!(root.find("Name").map(Element::text), Some("Tür <1>"));
    }

    #[test]
    fn garbage_has_a_reason_and_never_panics() {
        let deep = "<a>".repeat(200);
        let wide = format!("<a>{}</a>", "<b/>".repeat(60_000));
        for (text, expected) in [
            ("", "it is no XML"),
            ("hello", "it is no XML"),
            ("<a><b>", "it breaks off"),
            ("<a></b>", "it is no XML"),
            ("</a>", "it is no XML"),
            ("<a", "it is no XML"),
            (deep.as_str(), "too many elements"),
            (wide.as_str(), "too many elements"),
        ] {
            let problem = Element::parse(text.as_bytes()).expect_err("garbage");
            assert!(problem.contains(expected), "{}: {problem}", text.get(..9).unwrap_or(text));
        }
        let lossy = Element::parse(b"<a>\xff\x00</a>").expect("XML all the same");
        assert!(lossy.text().contains('\u{fffd}'));
    }

    #[test]
    fn every_cut_of_a_document_is_an_error_or_a_tree() {
        let text = "<a x='1'><b><![CDATA[y]]>&amp;</b><c/></a>";
        for end in 0..text.len() {
            assert!(Element::parse(&text.as_bytes()[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn a_name_with_markup_is_escaped() {
        assert_eq!(escape("<a & \"b\">\u{1}"), "&lt;a &amp; &quot;b&quot;&gt;");
    }
}
