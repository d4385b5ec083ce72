//! The table of transitions is the one that `docs/goals.md` shows. `UPDATE_EXPECT=1 cargo test -p
//! plan-execution` writes it there.

use std::fmt::{Debug, Write as _};
use std::path::PathBuf;

use plan_execution::TRANSITIONS;

const BEGIN: &str = "<!-- drawn from TRANSITIONS in plan-execution -->\n";
const END: &str = "<!-- end of the drawing -->\n";

/// Returns a name in the words of the docs: `StepLost` as “step lost”.
fn words(name: &impl Debug) -> String {
    let mut text = String::new();
    for letter in format!("{name:?}").chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push(' ');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

#[test]
fn the_docs_show_the_table_of_transitions() {
    let mut table = String::from("| event | in the phase | leads to |\n|---|---|---|\n");
    for row in TRANSITIONS {
        let to: Vec<_> = row.to.iter().map(words).collect();
        let _ =
            writeln!(table, "| {} | {} | {} |", words(&row.event), words(&row.from), to.join(", "));
    }
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../docs/goals.md");
    let page = std::fs::read_to_string(&path).expect("the page is there");
    let (head, rest) = page.split_once(BEGIN).expect("the page has the mark");
    let (_, tail) = rest.split_once(END).expect("the page has the second mark");
    let expected = format!("{head}{BEGIN}\n{table}\n{END}{tail}");
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(&path, &expected).expect("the page can be written");
    }
    assert_eq!(page, expected, "run again with UPDATE_EXPECT=1");
}
