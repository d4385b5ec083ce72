//! Checks the names in a template, so that an unknown name is reported when the template is parsed.

use minijinja::machinery::ast::{CallArg, Expr, Stmt};

use super::filters::{FILTERS, TESTS, pattern};

/// Names of Jinja's filters that have the same meaning in `minijinja`.
const JINJA_FILTERS: &[&str] = &[
    "abs",
    "batch",
    "capitalize",
    "count",
    "dictsort",
    "first",
    "format",
    "items",
    "join",
    "last",
    "length",
    "list",
    "lower",
    "map",
    "max",
    "min",
    "reject",
    "rejectattr",
    "replace",
    "reverse",
    "safe",
    "select",
    "selectattr",
    "slice",
    "sort",
    "string",
    "sum",
    "title",
    "trim",
    "unique",
    "upper",
];

const JINJA_TESTS: &[&str] = &[
    "boolean",
    "defined",
    "divisibleby",
    "eq",
    "equalto",
    "==",
    "even",
    "false",
    "float",
    "ge",
    ">=",
    "greaterthan",
    "gt",
    ">",
    "in",
    "integer",
    "iterable",
    "le",
    "<=",
    "lessthan",
    "lower",
    "lt",
    "<",
    "mapping",
    "ne",
    "!=",
    "none",
    "number",
    "odd",
    "sameas",
    "sequence",
    "string",
    "true",
    "undefined",
    "upper",
];

/// Names of functions that are not filters.
const FUNCTIONS: &[&str] = &["dict", "max", "min", "namespace", "range"];

/// Names of Python's methods of texts, lists and dictionaries.
const METHODS: &[&str] = &[
    "capitalize",
    "count",
    "endswith",
    "find",
    "format",
    "get",
    "isalnum",
    "isalpha",
    "isascii",
    "isdigit",
    "islower",
    "isnumeric",
    "isspace",
    "isupper",
    "items",
    "join",
    "keys",
    "lower",
    "lstrip",
    "replace",
    "rfind",
    "rstrip",
    "split",
    "splitlines",
    "startswith",
    "strip",
    "title",
    "upper",
    "values",
];

/// Maximum nesting depth of a template; a deeper one is rejected, because templates are evaluated
/// by recursion. A chain of operators counts as nested as well.
const DEPTH_MAX: usize = 100;

const CONSTANTS: &[&str] = &["e", "inf", "pi", "tau"];

/// Returns a problem about the first unknown name in a template; `None` if all names are known.
pub(super) fn unknown(tree: &Stmt<'_>, variables: &[&str]) -> Option<String> {
    let variables = variables.iter().map(|name| (*name).to_owned()).collect();
    let mut search = NameChecker { variables, depth: 0 };
    search.statement(tree)
}

struct NameChecker {
    /// Names of the variables that were defined so far, in any part of the template.
    variables: Vec<String>,
    depth: usize,
}

/// Evaluates expressions in order, and returns the first result that is `Some`.
macro_rules! first {
    ($first:expr $(, $next:expr)* $(,)?) => {
        $first$(.or_else(|| $next))*
    };
}

impl NameChecker {
    fn all(&mut self, statements: &[Stmt<'_>]) -> Option<String> {
        statements.iter().find_map(|statement| self.statement(statement))
    }

    /// Runs `look` one level deeper in the template. Returns a problem if the level is too deep.
    fn deeper(&mut self, look: impl FnOnce(&mut NameChecker) -> Option<String>) -> Option<String> {
        if self.depth >= DEPTH_MAX {
            return Some("it is nested too deeply".to_owned());
        }
        self.depth += 1;
        let found = look(self);
        self.depth -= 1;
        found
    }

    fn statement(&mut self, statement: &Stmt<'_>) -> Option<String> {
        self.deeper(|search| search.in_statement(statement))
    }

    fn in_statement(&mut self, statement: &Stmt<'_>) -> Option<String> {
        let refused = |what: &str| Some(format!("it has `{what}`, which is not known here"));
        match statement {
            Stmt::Template(template) => self.all(&template.children),
            Stmt::EmitRaw(_) => None,
            Stmt::EmitExpr(emit) => self.expression(&emit.expr),
            Stmt::IfCond(choice) => first!(
                self.expression(&choice.expr),
                self.all(&choice.true_body),
                self.all(&choice.false_body),
            ),
            Stmt::ForLoop(each) if each.recursive => refused("for … recursive"),
            Stmt::ForLoop(each) => {
                let iterated = self.expression(&each.iter);
                self.defines(&each.target);
                self.variables.push("loop".to_owned());
                first!(
                    iterated,
                    each.filter_expr.as_ref().and_then(|filter| self.expression(filter)),
                    self.all(&each.body),
                    self.all(&each.else_body),
                )
            }
            Stmt::Set(set) => {
                let found = self.expression(&set.expr);
                self.defines(&set.target);
                found
            }
            Stmt::SetBlock(block) => {
                let found = self.all(&block.body);
                self.defines(&block.target);
                found.or_else(|| block.filter.as_ref().and_then(|filter| self.expression(filter)))
            }
            Stmt::FilterBlock(block) => {
                first!(self.expression(&block.filter), self.all(&block.body))
            }
            Stmt::WithBlock(block) => {
                let mut found = None;
                for (target, value) in &block.assignments {
                    found = found.or_else(|| self.expression(value));
                    self.defines(target);
                }
                found.or_else(|| self.all(&block.body))
            }
            Stmt::AutoEscape(_) => refused("autoescape"),
            Stmt::Do(_) => refused("do"),
            // With other Cargo features, the parser has more kinds of statements.
            #[allow(unreachable_patterns, reason = "not with these features")]
            _ => refused("a statement"),
        }
    }

    fn defines(&mut self, target: &Expr<'_>) {
        match target {
            Expr::Var(variable) => self.variables.push(variable.id.to_owned()),
            Expr::Tuple(several) => several.items.iter().for_each(|item| self.defines(item)),
            Expr::List(several) => several.items.iter().for_each(|item| self.defines(item)),
            _ => (),
        }
    }

    fn expressions(&mut self, expressions: &[Expr<'_>]) -> Option<String> {
        expressions.iter().find_map(|expression| self.expression(expression))
    }

    fn optional(&mut self, expression: Option<&Expr<'_>>) -> Option<String> {
        expression.and_then(|expression| self.expression(expression))
    }

    fn expression(&mut self, expression: &Expr<'_>) -> Option<String> {
        self.deeper(|search| search.in_expression(expression))
    }

    fn in_expression(&mut self, expression: &Expr<'_>) -> Option<String> {
        match expression {
            Expr::Const(_) => None,
            Expr::Var(variable) => self.variable(variable.id),
            Expr::UnaryOp(operation) => self.expression(&operation.expr),
            Expr::BinOp(operation) => {
                first!(self.expression(&operation.left), self.expression(&operation.right))
            }
            Expr::Compare(chain) => first!(
                self.expression(&chain.expr),
                chain.ops.iter().find_map(|next| self.expression(&next.expr)),
            ),
            Expr::IfExpr(choice) => first!(
                self.expression(&choice.test_expr),
                self.expression(&choice.true_expr),
                self.optional(choice.false_expr.as_ref()),
            ),
            Expr::Filter(filter) => first!(
                self.optional(filter.expr.as_ref()),
                filter_problem(filter.name, &filter.args),
                self.arguments(&filter.args),
            ),
            Expr::Test(test) => first!(
                self.expression(&test.expr),
                test_problem(test.name, &test.args),
                self.arguments(&test.args),
            ),
            Expr::GetAttr(of) => self.expression(&of.expr),
            Expr::GetItem(of) => {
                first!(self.expression(&of.expr), self.expression(&of.subscript_expr))
            }
            Expr::Slice(slice) => first!(
                self.expression(&slice.expr),
                self.optional(slice.start.as_ref()),
                self.optional(slice.stop.as_ref()),
                self.optional(slice.step.as_ref()),
            ),
            Expr::Call(call) => {
                let problem = match &call.expr {
                    Expr::Var(function) => function_problem(function.id),
                    Expr::GetAttr(of) if !METHODS.contains(&of.name) => {
                        Some(format!("the method `{}` is not known here", of.name))
                    }
                    Expr::GetAttr(of) => self.expression(&of.expr),
                    _ => Some("it calls what is no function".to_owned()),
                };
                problem.or_else(|| self.arguments(&call.args))
            }
            Expr::List(list) => self.expressions(&list.items),
            Expr::Tuple(tuple) => self.expressions(&tuple.items),
            Expr::Map(map) => first!(self.expressions(&map.keys), self.expressions(&map.values)),
        }
    }

    fn variable(&self, name: &str) -> Option<String> {
        let is_known =
            CONSTANTS.contains(&name) || self.variables.iter().any(|known| known == name);
        (!is_known).then(|| format!("`{name}` is not known here"))
    }

    fn arguments(&mut self, arguments: &[CallArg<'_>]) -> Option<String> {
        arguments.iter().find_map(|argument| match argument {
            CallArg::Pos(value)
            | CallArg::Kwarg(_, value)
            | CallArg::PosSplat(value)
            | CallArg::KwargSplat(value) => self.expression(value),
        })
    }
}

fn is_filter(name: &str) -> bool {
    JINJA_FILTERS.contains(&name) || FILTERS.iter().any(|(known, _)| *known == name)
}

fn is_test(name: &str) -> bool {
    JINJA_TESTS.contains(&name) || TESTS.iter().any(|(known, _)| *known == name)
}

/// Returns the argument at `place` if it is a literal text; otherwise `None`.
fn text<'a>(arguments: &'a [CallArg<'_>], place: usize) -> Option<&'a str> {
    match arguments.get(place)? {
        CallArg::Pos(Expr::Const(constant)) => constant.value.as_str(),
        _ => None,
    }
}

fn filter_problem(name: &str, arguments: &[CallArg<'_>]) -> Option<String> {
    if !is_filter(name) {
        return Some(format!("the filter `{name}` is not known here"));
    }
    let test_at = match name {
        "map" => {
            let mapped = text(arguments, 0).filter(|mapped| !is_filter(mapped));
            return mapped.map(|mapped| format!("the filter `{mapped}` is not known here"));
        }
        "select" | "reject" => 0,
        "selectattr" | "rejectattr" => 1,
        name if name.starts_with("regex_") => return expression_problem(arguments),
        _ => return None,
    };
    let test = text(arguments, test_at).filter(|test| !is_test(test));
    test.map(|test| format!("the test `{test}` is not known here"))
}

fn test_problem(name: &str, arguments: &[CallArg<'_>]) -> Option<String> {
    match name {
        "match" | "search" => expression_problem(arguments),
        name if is_test(name) => None,
        name => Some(format!("the test `{name}` is not known here")),
    }
}

fn function_problem(name: &str) -> Option<String> {
    let is_own = FILTERS.iter().any(|(known, _)| *known == name);
    let is_known = is_own || FUNCTIONS.contains(&name);
    (!is_known).then(|| format!("the function `{name}` is not known here"))
}

fn expression_problem(arguments: &[CallArg<'_>]) -> Option<String> {
    let error = pattern(text(arguments, 0)?, false).err()?;
    error.detail().map(str::to_owned)
}
