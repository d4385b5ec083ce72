//! Renders templates like Home Assistant: Jinja with Home Assistant's filters and tests, Python's
//! methods, and Python's rules for errors.
//!
//! - `minijinja` parses a template and implements Jinja's own filters; `eval` evaluates the
//!   template. `eval` follows Python where `minijinja` does not: for example, comparing a number
//!   with an undefined value is an error, not false.
//! - `names` checks every filter, test, function and method in a template before any message
//!   arrives. Therefore an unknown one is refused by its name when a device is discovered.
//! - `filters` implements Home Assistant's own filters and tests; `numbers` implements Python's
//!   arithmetic.
//!
//! The results were compared with Home Assistant 2024.3. The outputs of Home Assistant are in
//! `plugins/gateways/mqtt/tests/templates.tsv`.

mod eval;
mod filters;
mod names;
mod numbers;

use minijinja::machinery::{ast, parse};
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, Error, Value};

use eval::Evaluation;

/// Maximum length of a template, in bytes; a longer one is rejected.
const BYTES_MAX: usize = 1 << 13;

/// A valid template: it can be parsed, and contains no unknown names. Rendering may still fail.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Template(String);

/// Reason why a template has no output for one particular text.
#[derive(Debug)]
pub(crate) struct Unrendered(pub(crate) String);

impl Template {
    /// Parses a template that may use the variables `variables`.
    ///
    /// # Errors
    ///
    /// Returns an error if the template is too long or nested too deeply, has a syntax error, or
    /// uses an unknown name.
    pub(crate) fn new(text: &str, variables: &[&str]) -> Result<Template, String> {
        let said = |problem: String| format!("the template `{}`: {problem}", shortened(text));
        if text.len() > BYTES_MAX {
            return Err(said(format!("it is longer than {BYTES_MAX} bytes")));
        }
        if is_deep(text) {
            return Err(said("it is nested too deeply".to_owned()));
        }
        let tree = read(text).map_err(|error| said(error.to_string()))?;
        match names::unknown(&tree, variables) {
            Some(unknown) => Err(said(unknown)),
            None => Ok(Template(text.to_owned())),
        }
    }

    /// Returns the output of the template for a text of a device. The variable `value` is the text,
    /// and `value_json` is its content if the text is JSON.
    ///
    /// # Errors
    ///
    /// Returns an error if the template cannot be rendered. Like Home Assistant, the caller then
    /// ignores the text and keeps the earlier value of the feature.
    pub(crate) fn of_word(&self, word: &str) -> Result<String, Unrendered> {
        let mut variables = vec![("value", Value::from(word))];
        if let Ok(json) = serde_json::from_str::<serde_json::Value>(word) {
            variables.push(("value_json", Value::from(Serde(json))));
        }
        self.render(&variables)
    }

    /// Returns the output of the template with these variables.
    ///
    /// # Errors
    ///
    /// Returns an error if the template cannot be rendered.
    pub(crate) fn render(&self, variables: &[(&str, Value)]) -> Result<String, Unrendered> {
        let rendered = || -> Result<String, Error> {
            let environment = environment();
            let tree = read(&self.0)?;
            let text = Evaluation::of(&environment, variables).text(&tree)?;
            Ok(text.trim().to_owned())
        };
        rendered().map_err(|error| {
            Unrendered(format!(
                "the template `{}`: {}",
                shortened(&self.0),
                shortened(&error.to_string())
            ))
        })
    }
}

fn read(text: &str) -> Result<ast::Stmt<'_>, Error> {
    parse(text, "template", SyntaxConfig::default())
}

/// Whether a text could exhaust the stack of the parser, which recurses for each bracket and sign.
fn is_deep(text: &str) -> bool {
    const DEPTH_MAX: usize = 50;
    let mut depth = 0_usize;
    let is_nested = text.chars().any(|c| {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            _ => (),
        }
        depth > DEPTH_MAX
    });
    let together: String = text.split_whitespace().collect();
    let signs = ["not", "-", "-(", "not(", "(-", "(not"];
    is_nested || signs.iter().any(|sign| together.contains(&sign.repeat(DEPTH_MAX)))
}

fn environment() -> Environment<'static> {
    let mut environment = Environment::new();
    environment.set_fuel(Some(eval::STEPS_MAX));
    environment.set_unknown_method_callback(minijinja_contrib::pycompat::unknown_method_callback);
    filters::register(&mut environment);
    environment
}

/// Shortens a text for a message to people.
fn shortened(text: &str) -> String {
    const TOLD_CHARS: usize = 120;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= TOLD_CHARS {
        return line;
    }
    line.chars().take(TOLD_CHARS).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Templates, texts of devices, and the outputs of Home Assistant; `!` means that Home
    /// Assistant ignores the text.
    const CASES: &str = include_str!("../../tests/templates.tsv");

    #[test]
    fn templates_render_as_in_home_assistant() {
        let (mut wrong, mut usual) = (Vec::new(), "");
        for line in CASES.lines().filter(|line| !line.starts_with('#')) {
            let parts: Vec<_> = line.split('\t').collect();
            let [template, word, expected] = parts[..] else { panic!("{line}") };
            if template == "@" {
                usual = word;
                continue;
            }
            let word = if word == "@" { usual } else { word };
            let said = match Template::new(template, &["value", "value_json"]) {
                Ok(template) => template.of_word(word).unwrap_or_else(|_| "!".to_owned()),
                Err(problem) => problem,
            };
            if said != expected {
                wrong.push(format!("{template}  {word}: {said:?}, not {expected:?}"));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    #[test]
    fn an_unknown_name_in_a_template_is_refused_by_name() {
        for (template, name) in [
            ("{{ states('sensor.x') }}", "`states`"),
            ("{{ is_state('sensor.x', 'on') }}", "`is_state`"),
            ("{{ now().hour }}", "`now`"),
            ("{{ utcnow() }}", "`utcnow`"),
            ("{{ value | timestamp_custom('%H') }}", "`timestamp_custom`"),
            ("{% if false %}{{ value | nonsense }}{% endif %}", "`nonsense`"),
            ("{{ value.encode('utf-8') }}", "`encode`"),
            ("{{ this.state }}", "`this`"),
            ("{{ value is odd_thing }}", "`odd_thing`"),
            ("{% include 'x' %}", "include"),
            ("{{ value_json. }}", "syntax error"),
            ("{{ value | regex_replace('(', '') }}", "regular expression"),
            ("{{ value_json.l | map('nonsense') | list }}", "`nonsense`"),
            ("{{ value | float | log10 }}", "`log10`"),
        ] {
            let problem = Template::new(template, &["value", "value_json"]).expect_err(template);
            assert!(problem.contains(name), "{problem}");
            assert!(problem.starts_with("the template `"), "{problem}");
        }
    }

    #[test]
    fn a_template_that_exceeds_its_budget_is_an_error() {
        for template in [
            "{% for i in range(100000) %}{{ i }}{% endfor %}",
            "{% for i in range(9999) %}{% for j in range(9999) %}x{% endfor %}{% endfor %}",
            "{{ 'x' * 1000000000 }}",
            "{{ ('x' * 1000) * 100000 }}",
            "{{ '%999999999d' % 3 }}",
            "{{ '%999999999d' | format(3) }}",
            "{{ 9 ** 9 ** 9 }}",
            "{{ range(1000000000) | list }}",
            "{% set x = 'aaaaaaaa' %}{% for i in range(99) %}{% set x = x ~ x %}{% endfor %}",
        ] {
            let template = Template::new(template, &["value", "value_json"]).expect(template);
            let began = std::time::Instant::now();
            let _ = template.of_word("{}");
            assert!(began.elapsed().as_secs() < 5, "{template:?}");
        }
        let deep = format!("{{{{ {}1{} }}}}", "(".repeat(5_000), ")".repeat(5_000));
        assert!(Template::new(&deep, &[]).is_err());
        let deep = format!("{{{{ {}1 }}}}", "not ".repeat(3_000));
        assert!(Template::new(&deep, &[]).is_err());
        let deep = format!("{{{{ {}1 }}}}", "-".repeat(3_000));
        assert!(Template::new(&deep, &[]).is_err());
        for chain in ["1 + ", "1 ~ ", "1 if ", "x or "] {
            let deep = format!("{{{{ {}1 }}}}", chain.repeat(2_000));
            assert!(Template::new(&deep, &["x"]).is_err(), "{chain}");
        }
        let wide = format!("{{{{ {}1 }}}}", "1 + ".repeat(60));
        let wide = Template::new(&wide, &[]).expect("it is no such nest");
        assert_eq!(wide.of_word("x").expect("a sum"), "61");
    }

    #[test]
    fn endless_nesting_or_growth_is_an_error() {
        let again = |body: &str| {
            format!(
                "{{% set ns = namespace(x=[], y='') %}}{{% for i in range(7000) %}}{body}\
                 {{% endfor %}}{{{{ ns.x }}}}"
            )
        };
        for template in [
            again("{% set ns.x = [ns.x] %}"),
            again("{% set ns.x = (ns.x,) %}"),
            again("{% set ns.x = {'x': ns.x} %}"),
            again("{% set ns.x = dict(x=ns.x) %}"),
            again("{% set ns.x = ns.x | batch(1) | list %}"),
            again("{% set ns.x = [ns.x] | slice(1) | list %}"),
            again("{% set ns.x = [ns.x, ns.x] %}"),
            again("{% set ns.x = ns.x + [ns.x, 1] %}"),
            again("{% set ns.x = ns %}"),
            again("{% set ns.x = [ns] %}"),
            again("{% set ns.x = namespace(x=ns) %}"),
            again("{% set ns.x = {'x': ns.x}.items() | list %}"),
            again("{% set ns.y = ns.y ~ 'xxxxxxxxxxxxxxxxxxxx' ~ ns.y %}"),
            again("{% set ns.x = max(*range(99999), *range(99999), *range(99999)) %}"),
            "{{ ('x' * 1000000) | regex_replace('x', 'y' * 100000) }}".to_owned(),
            "{{ ('x' * 1000000) | regex_replace('', 'y' * 100000) }}".to_owned(),
            "{{ ('x' * 1000000) | regex_replace('(.*)', '\\\\1' * 100000) }}".to_owned(),
            "{{ ('x' * 1000000) | regex_findall('()' * 900) }}".to_owned(),
            "{{ ('x' * 1000000) | regex_findall('(' * 10 + '.*' + ')' * 10) }}".to_owned(),
            "{{ ('x' * 1000000) | replace('x', 'y' * 100000) }}".to_owned(),
            "{{ ('x' * 1000000).replace('x', 'y' * 100000) }}".to_owned(),
            "{{ ('x' * 1000000) | replace('', 'y' * 100000) }}".to_owned(),
            "{{ range(90000) | join('y' * 1000000) }}".to_owned(),
            "{{ ('y' * 1000000).join(range(90000)) }}".to_owned(),
            "{{ ('x ' * 500000) | slugify('y' * 1000000) }}".to_owned(),
            "{{ [1] | batch(1000000000, 'x') | list }}".to_owned(),
            "{{ [1] | slice(1000000000, 'x') | list }}".to_owned(),
            "{{ '{:>999999999}'.format('x') }}".to_owned(),
            "{{ '{:>{}}'.format('x', 999999999) }}".to_owned(),
            "{{ ('{0}' * 100000).format('x' * 1000000) }}".to_owned(),
            "{{ ('%(x)s' * 100000) % {'x': 'y' * 1000000} }}".to_owned(),
            "{{ ['%(x)s' * 100000] | map('format', x='y' * 1000000) | list }}".to_owned(),
            "{{ '%*d' % (999999999, 3) }}".to_owned(),
            "{{ range(90000) | map('replace', '', 'y' * 1000000) | list }}".to_owned(),
            "{{ range(90000) | map('regex_replace', '^', 'y' * 1000000) | list }}".to_owned(),
            "{{ ['%s' * 300000] * 300000 }}".to_owned(),
        ] {
            let template = Template::new(&template, &["value", "value_json"]).expect(&template);
            let began = std::time::Instant::now();
            assert!(template.of_word("{}").is_err(), "{template:?}");
            assert!(began.elapsed().as_secs() < 60, "{template:?}");
        }
        // A value of the maximum size of a device's text is accepted.
        let nest = format!("{}7{}", "[".repeat(120), "]".repeat(120));
        let template = Template::new("{{ [value_json] }}", &["value_json"]).expect("it is right");
        assert_eq!(template.of_word(&nest).expect("it is no nest"), format!("[{nest}]"));
        let template = "{% set ns = namespace(x=[]) %}{% for i in range(500) %}\
                        {% set ns.x = ns.x + [i] %}{% endfor %}{{ ns.x | sum }}";
        let template = Template::new(template, &[]).expect("it is right");
        assert_eq!(template.of_word("x").expect("a sum"), "124750");
    }
}
