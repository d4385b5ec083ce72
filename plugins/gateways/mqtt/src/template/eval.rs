//! Evaluates a Jinja template according to Python's rules.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use minijinja::machinery::ast::{
    BinOpKind, CallArg, CompareOpKind, Expr, ForLoop, Slice, Stmt, UnaryOpKind,
};
use minijinja::value::{Kwargs, Object, Tuple, ValueKind};
use minijinja::{Environment, Error, State, Value};

use super::filters::{self, printed};
use super::numbers::{
    self, ArithmeticOperator, TEXT_BYTES_MAX, WEIGHT_OF_STEP, calculated, missing, weight, wrong,
};

/// Maximum number of steps in one rendering of a template; a rendering that needs more fails. The
/// number is also the fuel of minijinja.
pub(super) const STEPS_MAX: u64 = 50_000;

/// Filters that iterate over the parts of their value.
const GO_THROUGH: &[&str] = &[
    "batch",
    "count",
    "first",
    "join",
    "last",
    "length",
    "list",
    "map",
    "max",
    "min",
    "reject",
    "rejectattr",
    "reverse",
    "select",
    "selectattr",
    "slice",
    "sort",
    "sum",
    "unique",
];

/// One evaluation of a template.
pub(super) struct Evaluation<'e> {
    state: State<'e, 'e>,
    /// Variables of each enclosing block of the template, with the innermost block last.
    scopes: Vec<BTreeMap<String, Value>>,
    steps: u64,
    text: String,
}

/// The result of Jinja's `namespace`: an object with attributes that the template can set.
#[derive(Debug, Default)]
struct JinjaNamespace(Mutex<BTreeMap<String, Value>>);

impl Object for JinjaNamespace {
    fn get_value(self: &Arc<Self>, key: &Value) -> Option<Value> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(key.as_str()?).cloned()
    }
}

impl<'e> Evaluation<'e> {
    pub(super) fn of(
        environment: &'e Environment<'e>,
        variables: &[(&str, Value)],
    ) -> Evaluation<'e> {
        let variables = variables.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
        let (state, scopes) = (environment.empty_state(), vec![variables.collect()]);
        Evaluation { state, scopes, steps: 0, text: String::new() }
    }

    /// Returns the output of a template.
    pub(super) fn text(mut self, tree: &Stmt<'_>) -> Result<String, Error> {
        self.execute(tree)?;
        Ok(self.text)
    }

    fn step(&mut self) -> Result<(), Error> {
        self.steps += 1;
        if self.steps > STEPS_MAX {
            return Err(wrong("it takes too long"));
        }
        Ok(())
    }

    fn append_output(&mut self, text: &str) -> Result<(), Error> {
        if self.text.len() + text.len() > TEXT_BYTES_MAX {
            return Err(wrong("its text becomes too long"));
        }
        self.text.push_str(text);
        Ok(())
    }

    fn all(&mut self, statements: &[Stmt<'_>]) -> Result<(), Error> {
        statements.iter().try_for_each(|statement| self.execute(statement))
    }

    fn execute(&mut self, statement: &Stmt<'_>) -> Result<(), Error> {
        self.step()?;
        match statement {
            Stmt::Template(template) => self.all(&template.children),
            Stmt::EmitRaw(raw) => self.append_output(raw.raw),
            Stmt::EmitExpr(emit) => {
                let value = self.value(&emit.expr)?;
                let text = printed(&value);
                self.append_output(&text)
            }
            Stmt::IfCond(choice) => match self.value(&choice.expr)?.is_true() {
                true => self.all(&choice.true_body),
                false => self.all(&choice.false_body),
            },
            Stmt::ForLoop(each) => self.execute_loop(each),
            Stmt::Set(set) => {
                let value = self.value(&set.expr)?;
                self.assign(&set.target, value)
            }
            Stmt::SetBlock(block) => {
                let before = std::mem::take(&mut self.text);
                let done = self.all(&block.body);
                let inner = std::mem::replace(&mut self.text, before);
                done?;
                let mut value = Value::from(inner);
                if let Some(filter) = &block.filter {
                    value = self.filtered(filter, value)?;
                }
                self.assign(&block.target, value)
            }
            Stmt::FilterBlock(block) => {
                let before = std::mem::take(&mut self.text);
                let done = self.all(&block.body);
                let inner = std::mem::replace(&mut self.text, before);
                done?;
                let text = printed(&self.filtered(&block.filter, Value::from(inner))?);
                self.append_output(&text)
            }
            Stmt::WithBlock(block) => {
                self.scopes.push(BTreeMap::new());
                let mut done = Ok(());
                for (target, value) in &block.assignments {
                    done = done.and_then(|()| {
                        let value = self.value(value)?;
                        self.assign(target, value)
                    });
                }
                done = done.and_then(|()| self.all(&block.body));
                self.scopes.pop();
                done
            }
            // All other statements are refused by name when the template is parsed.
            _ => Err(wrong("it has a statement that is not known here")),
        }
    }

    fn execute_loop(&mut self, each: &ForLoop<'_>) -> Result<(), Error> {
        let iterated = self.value(&each.iter)?;
        let items: Vec<Value> = match iterated.kind() {
            ValueKind::Undefined => Vec::new(),
            ValueKind::None | ValueKind::Number | ValueKind::Bool => {
                return Err(wrong(format!("a `{}` has no parts", iterated.kind())));
            }
            ValueKind::String => letters(&iterated).map(Value::from).collect(),
            _ => iterated.try_iter()?.collect(),
        };
        self.charge(items.len())?;
        let mut chosen = Vec::new();
        for item in items {
            self.step()?;
            self.scopes.push(BTreeMap::new());
            let is_chosen = self.assign(&each.target, item.clone()).and_then(|()| {
                each.filter_expr
                    .as_ref()
                    .map_or(Ok(true), |filter| Ok(self.value(filter)?.is_true()))
            });
            self.scopes.pop();
            if is_chosen? {
                chosen.push(item);
            }
        }
        let count = chosen.len();
        for (index, item) in chosen.into_iter().enumerate() {
            self.step()?;
            self.scopes.push(BTreeMap::new());
            let about = minijinja::context! {
                index => index + 1, index0 => index, first => index == 0,
                last => index + 1 == count, length => count,
                revindex => count - index, revindex0 => count - index - 1,
            };
            self.set("loop", about);
            let done = self.assign(&each.target, item).and_then(|()| self.all(&each.body));
            self.scopes.pop();
            done?;
        }
        if count == 0 { self.all(&each.else_body) } else { Ok(()) }
    }

    fn set(&mut self, name: &str, value: Value) {
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.to_owned(), value);
        }
    }

    fn assign(&mut self, target: &Expr<'_>, value: Value) -> Result<(), Error> {
        let parts = match target {
            Expr::Var(variable) => {
                self.set(variable.id, value);
                return Ok(());
            }
            Expr::GetAttr(of) => {
                let space = self.value(&of.expr)?;
                let Some(space) = space.downcast_object_ref::<JinjaNamespace>() else {
                    return Err(wrong("only a namespace's attributes can be set"));
                };
                if has_namespace(&value) {
                    return Err(wrong("a namespace cannot be in a namespace"));
                }
                let mut attributes = space.0.lock().unwrap_or_else(PoisonError::into_inner);
                attributes.insert(of.name.to_owned(), value);
                return Ok(());
            }
            Expr::Tuple(several) => &several.items,
            Expr::List(several) => &several.items,
            _ => return Err(wrong("this cannot be set")),
        };
        let values: Vec<Value> = value.try_iter()?.collect();
        if values.len() != parts.len() {
            return Err(wrong("there are not as many values as variables"));
        }
        parts.iter().zip(values).try_for_each(|(part, value)| self.assign(part, value))
    }

    /// Returns the value of an expression. The size of a computed value is charged to the budget,
    /// so that no value can nest or grow without limit.
    fn value(&mut self, expression: &Expr<'_>) -> Result<Value, Error> {
        self.step()?;
        let value = self.evaluate(expression)?;
        let is_made = !matches!(expression, Expr::Const(_) | Expr::Var(_) | Expr::GetAttr(_));
        let is_plain =
            matches!(value.kind(), ValueKind::None | ValueKind::Bool | ValueKind::Number);
        if is_made && !is_plain && !value.is_undefined() {
            self.charge(weight(&value)?)?;
        }
        Ok(value)
    }

    /// Charges `weight` to the budget of this rendering. Returns an error if the budget is
    /// exceeded.
    fn charge(&self, weight: usize) -> Result<(), Error> {
        let steps = u64::try_from(weight / WEIGHT_OF_STEP).unwrap_or(u64::MAX);
        self.state.consume_fuel(steps)
    }

    fn evaluate(&mut self, expression: &Expr<'_>) -> Result<Value, Error> {
        match expression {
            Expr::Const(constant) => Ok(constant.value.clone()),
            Expr::Var(variable) => Ok(self.variable(variable.id)),
            Expr::UnaryOp(operation) => unary(&operation.op, &self.value(&operation.expr)?),
            Expr::BinOp(operation) => {
                let one = self.value(&operation.left)?;
                match operation.op {
                    BinOpKind::ScAnd if !one.is_true() => return Ok(one),
                    BinOpKind::ScOr if one.is_true() => return Ok(one),
                    _ => (),
                }
                let other = self.value(&operation.right)?;
                self.apply_operator(&operation.op, one, other)
            }
            Expr::Compare(chain) => {
                let mut one = self.value(&chain.expr)?;
                for next in &chain.ops {
                    let other = self.value(&next.expr)?;
                    if !self.holds(&next.op, &one, &other)? {
                        return Ok(Value::from(false));
                    }
                    one = other;
                }
                Ok(Value::from(true))
            }
            Expr::IfExpr(choice) => match self.value(&choice.test_expr)?.is_true() {
                true => self.value(&choice.true_expr),
                false => {
                    choice.false_expr.as_ref().map_or(Ok(Value::UNDEFINED), |no| self.value(no))
                }
            },
            Expr::Filter(filter) => {
                let value = match &filter.expr {
                    Some(of) => self.value(of)?,
                    None => Value::UNDEFINED,
                };
                self.filtered(expression, value)
            }
            Expr::Test(test) => {
                let mut arguments = vec![self.value(&test.expr)?];
                arguments.extend(self.arguments(&test.args)?);
                self.tested(test.name, &arguments).map(Value::from)
            }
            Expr::GetAttr(of) => {
                let whole = self.value(&of.expr)?;
                part(&whole, &Value::from(of.name))
            }
            Expr::GetItem(of) => {
                let (whole, key) = (self.value(&of.expr)?, self.value(&of.subscript_expr)?);
                part(&whole, &key)
            }
            Expr::Slice(slice) => self.sliced(slice),
            Expr::Call(call) => self.called(&call.expr, &call.args),
            Expr::List(list) => self.values(&list.items).map(Value::from),
            Expr::Tuple(tuple) => self.values(&tuple.items).map(|items| Tuple::from(items).into()),
            Expr::Map(map) => {
                let (keys, values) = (self.values(&map.keys)?, self.values(&map.values)?);
                Ok(keys.into_iter().zip(values).collect::<BTreeMap<_, _>>().into())
            }
        }
    }

    fn values(&mut self, expressions: &[Expr<'_>]) -> Result<Vec<Value>, Error> {
        expressions.iter().map(|expression| self.value(expression)).collect()
    }

    fn variable(&self, name: &str) -> Value {
        let known = self.scopes.iter().rev().find_map(|scope| scope.get(name));
        match (known, name) {
            (Some(known), _) => known.clone(),
            (None, "pi") => Value::from(std::f64::consts::PI),
            (None, "e") => Value::from(std::f64::consts::E),
            (None, "tau") => Value::from(std::f64::consts::TAU),
            (None, "inf") => Value::from(f64::INFINITY),
            _ => Value::UNDEFINED,
        }
    }

    fn apply_operator(&mut self, op: &BinOpKind, one: Value, other: Value) -> Result<Value, Error> {
        let operator = match op {
            BinOpKind::ScAnd | BinOpKind::ScOr => return Ok(other),
            BinOpKind::Concat => {
                let texts = [printed(&one), printed(&other)];
                return numbers::joined(&[&texts[0], &texts[1]]).map(Value::from);
            }
            // In Python, `%` formats values into a text.
            BinOpKind::Rem if one.as_str().is_some() => {
                let is_format = one.as_str().is_some_and(|text| text.contains('%'));
                if !is_format && other.kind() != ValueKind::Map {
                    return Err(wrong("the text has no place for a value"));
                }
                let mut arguments = vec![one];
                match other.kind() {
                    ValueKind::Seq => arguments.extend(other.try_iter()?),
                    _ => arguments.push(other),
                }
                return self.state.apply_filter("format", &arguments);
            }
            BinOpKind::Add => ArithmeticOperator::Add,
            BinOpKind::Sub => ArithmeticOperator::Subtract,
            BinOpKind::Mul => ArithmeticOperator::Multiply,
            BinOpKind::Div => ArithmeticOperator::Divide,
            BinOpKind::FloorDiv => ArithmeticOperator::DivideWhole,
            BinOpKind::Rem => ArithmeticOperator::Remainder,
            BinOpKind::Pow => ArithmeticOperator::Power,
            BinOpKind::Eq => return Ok(numbers::is_equal(&one, &other).into()),
            BinOpKind::Ne => return Ok((!numbers::is_equal(&one, &other)).into()),
            BinOpKind::Lt => return self.holds(&CompareOpKind::Lt, &one, &other).map(Value::from),
            BinOpKind::Lte => {
                return self.holds(&CompareOpKind::Lte, &one, &other).map(Value::from);
            }
            BinOpKind::Gt => return self.holds(&CompareOpKind::Gt, &one, &other).map(Value::from),
            BinOpKind::Gte => {
                return self.holds(&CompareOpKind::Gte, &one, &other).map(Value::from);
            }
            BinOpKind::In => return self.holds(&CompareOpKind::In, &one, &other).map(Value::from),
        };
        calculated(operator, &one, &other)
    }

    fn holds(&mut self, op: &CompareOpKind, one: &Value, other: &Value) -> Result<bool, Error> {
        let order = |is_so: fn(Ordering) -> bool| {
            numbers::compared(one, other).map(|order| order.is_some_and(is_so))
        };
        match op {
            CompareOpKind::Eq => Ok(numbers::is_equal(one, other)),
            CompareOpKind::Ne => Ok(!numbers::is_equal(one, other)),
            CompareOpKind::Lt => order(Ordering::is_lt),
            CompareOpKind::Lte => order(Ordering::is_le),
            CompareOpKind::Gt => order(Ordering::is_gt),
            CompareOpKind::Gte => order(Ordering::is_ge),
            CompareOpKind::In => contains(other, one),
            CompareOpKind::NotIn => contains(other, one).map(|is_in| !is_in),
        }
    }

    fn filtered(&mut self, filter: &Expr<'_>, value: Value) -> Result<Value, Error> {
        let Expr::Filter(filter) = filter else { return Err(wrong("a filter is expected")) };
        let mut arguments = vec![value];
        arguments.extend(self.arguments(&filter.args)?);
        self.applied(filter.name, &arguments)
    }

    /// Applies one of Home Assistant's filters or one of Jinja's filters.
    fn applied(&mut self, name: &str, arguments: &[Value]) -> Result<Value, Error> {
        match filters::applied(&self.state, name, arguments) {
            Some(own) => own,
            None if GO_THROUGH.contains(&name) && arguments.first().is_some_and(is_single) => {
                Err(wrong(format!("`{name}` needs several values, and gets one")))
            }
            None => self.state.apply_filter(name, arguments),
        }
    }

    fn tested(&mut self, name: &str, arguments: &[Value]) -> Result<bool, Error> {
        let compares = match name {
            "eq" | "equalto" | "==" => Some(CompareOpKind::Eq),
            "ne" | "!=" => Some(CompareOpKind::Ne),
            "lt" | "lessthan" | "<" => Some(CompareOpKind::Lt),
            "le" | "<=" => Some(CompareOpKind::Lte),
            "gt" | "greaterthan" | ">" => Some(CompareOpKind::Gt),
            "ge" | ">=" => Some(CompareOpKind::Gte),
            "in" => Some(CompareOpKind::In),
            _ => None,
        };
        match (compares, arguments) {
            (Some(op), [one, other]) => self.holds(&op, one, other),
            _ => match filters::tested(&self.state, name, arguments) {
                Some(own) => own,
                None => self.state.perform_test(name, arguments),
            },
        }
    }

    fn called(&mut self, what: &Expr<'_>, arguments: &[CallArg<'_>]) -> Result<Value, Error> {
        match what {
            Expr::Var(function) => {
                let arguments = self.arguments(arguments)?;
                self.function(function.id, &arguments)
            }
            Expr::GetAttr(of) => {
                let whole = self.value(&of.expr)?;
                let arguments = self.arguments(arguments)?;
                if whole.is_undefined() {
                    return Err(missing());
                }
                if of.name == "format" {
                    let values: Vec<_> = [&whole].into_iter().chain(&arguments).cloned().collect();
                    filters::formattable(&values, '{')?;
                }
                whole.call_method(&mut self.state, of.name, &arguments)
            }
            _ => Err(wrong("this cannot be called")),
        }
    }

    fn function(&mut self, name: &str, arguments: &[Value]) -> Result<Value, Error> {
        match name {
            "namespace" => {
                let mut attributes = BTreeMap::new();
                for argument in arguments {
                    for key in argument.try_iter()? {
                        let value = argument.get_item(&key)?;
                        if has_namespace(&value) {
                            return Err(wrong("a namespace cannot be in a namespace"));
                        }
                        attributes.insert(key.to_string(), value);
                    }
                }
                Ok(Value::from_object(JinjaNamespace(Mutex::new(attributes))))
            }
            "min" | "max" if arguments.len() > 1 => {
                let all = Value::from(arguments.to_vec());
                self.state.apply_filter(name, &[all])
            }
            "range" | "dict" => {
                match self.state.env().globals().find(|(global, _)| *global == name) {
                    Some((_, function)) => function.call(&mut self.state, arguments),
                    None => Err(wrong(format!("there is no `{name}`"))),
                }
            }
            // All other functions are also filters.
            name => self.applied(name, arguments),
        }
    }

    fn arguments(&mut self, arguments: &[CallArg<'_>]) -> Result<Vec<Value>, Error> {
        let (mut positional, mut named) = (Vec::new(), Vec::<(String, Value)>::new());
        for argument in arguments {
            match argument {
                CallArg::Pos(value) => positional.push(self.value(value)?),
                CallArg::Kwarg(name, value) => named.push(((*name).to_owned(), self.value(value)?)),
                CallArg::PosSplat(values) => {
                    for value in self.value(values)?.try_iter()? {
                        self.step()?;
                        positional.push(value);
                    }
                }
                CallArg::KwargSplat(values) => {
                    let values = self.value(values)?;
                    for key in values.try_iter()? {
                        self.step()?;
                        named.push((key.to_string(), values.get_item(&key)?));
                    }
                }
            }
        }
        if !named.is_empty() {
            positional.push(named.into_iter().collect::<Kwargs>().into());
        }
        Ok(positional)
    }

    fn sliced(&mut self, slice: &Slice<'_>) -> Result<Value, Error> {
        let whole = self.value(&slice.expr)?;
        let mut bound = |bound: &Option<Expr<'_>>| -> Result<Option<i64>, Error> {
            let Some(bound) = bound else { return Ok(None) };
            let bound = self.value(bound)?;
            if bound.is_none() {
                return Ok(None);
            }
            i64::try_from(bound).map(Some)
        };
        let (start, stop, step) = (bound(&slice.start)?, bound(&slice.stop)?, bound(&slice.step)?);
        let items: Vec<Value> = match whole.kind() {
            ValueKind::String => letters(&whole).map(Value::from).collect(),
            ValueKind::Seq => whole.try_iter()?.collect(),
            ValueKind::Undefined => return Err(missing()),
            kind => return Err(wrong(format!("a `{kind}` has no parts"))),
        };
        let items = python_slice(items, start, stop, step.unwrap_or(1))?;
        Ok(match whole.kind() {
            ValueKind::String => items.iter().map(ToString::to_string).collect::<String>().into(),
            _ => Value::from(items),
        })
    }
}

/// Returns the slice `items[start:stop:step]` as Python does.
fn python_slice(
    items: Vec<Value>,
    start: Option<i64>,
    stop: Option<i64>,
    step: i64,
) -> Result<Vec<Value>, Error> {
    if step == 0 {
        return Err(wrong("a slice cannot have a step of zero"));
    }
    let count = i64::try_from(items.len()).unwrap_or(i64::MAX);
    let (least, most) = if step > 0 { (0, count) } else { (-1, count - 1) };
    let within = |bound: i64| {
        let bound = if bound < 0 { bound.saturating_add(count) } else { bound };
        bound.clamp(least, most)
    };
    let start = start.map_or(if step > 0 { 0 } else { count - 1 }, within);
    let stop = stop.map_or(if step > 0 { count } else { -1 }, within);
    let (mut taken, mut at) = (Vec::new(), start);
    while if step > 0 { at < stop } else { at > stop } {
        taken.extend(usize::try_from(at).ok().and_then(|at| items.get(at)).cloned());
        at = at.saturating_add(step);
    }
    Ok(taken)
}

/// Whether a value is a namespace or contains one, so that the value could contain itself. This
/// recursion ends, because the size of every variable was checked before.
fn has_namespace(value: &Value) -> bool {
    if value.downcast_object_ref::<JinjaNamespace>().is_some() {
        return true;
    }
    let parts = || value.try_iter().into_iter().flatten();
    match value.kind() {
        ValueKind::Seq | ValueKind::Iterable => parts().any(|part| has_namespace(&part)),
        ValueKind::Map => {
            parts().any(|key| value.get_item(&key).is_ok_and(|part| has_namespace(&part)))
        }
        _ => false,
    }
}

/// Whether a value has no parts, unlike a list or a dictionary.
fn is_single(value: &Value) -> bool {
    matches!(value.kind(), ValueKind::None | ValueKind::Bool | ValueKind::Number)
}

fn letters(text: &Value) -> impl Iterator<Item = String> {
    let letters: Vec<_> = text.as_str().unwrap_or_default().chars().map(String::from).collect();
    letters.into_iter()
}

/// Returns the value of a unary operation.
fn unary(operator: &UnaryOpKind, value: &Value) -> Result<Value, Error> {
    match operator {
        UnaryOpKind::Not => Ok(Value::from(!value.is_true())),
        UnaryOpKind::Neg => calculated(ArithmeticOperator::Subtract, &Value::from(0), value),
    }
}

/// Returns the part of `whole` under `key`; the undefined value if there is no such part. Returns
/// an error if `whole` itself is undefined.
fn part(whole: &Value, key: &Value) -> Result<Value, Error> {
    match whole.kind() {
        ValueKind::Undefined => Err(missing()),
        ValueKind::String => {
            let text = whole.as_str().unwrap_or_default();
            let Ok(index) = i64::try_from(key.clone()) else { return Ok(Value::UNDEFINED) };
            let count = i64::try_from(text.chars().count()).unwrap_or(i64::MAX);
            let index = if index < 0 { index + count } else { index };
            let letter = usize::try_from(index).ok().and_then(|index| text.chars().nth(index));
            Ok(letter.map_or(Value::UNDEFINED, |letter| Value::from(letter.to_string())))
        }
        ValueKind::None | ValueKind::Bool | ValueKind::Number => Ok(Value::UNDEFINED),
        _ => Ok(whole.get_item(key).unwrap_or(Value::UNDEFINED)),
    }
}

fn contains(whole: &Value, part: &Value) -> Result<bool, Error> {
    match whole.kind() {
        ValueKind::Undefined => Ok(false),
        ValueKind::String => match part.as_str() {
            Some(part) => Ok(whole.as_str().unwrap_or_default().contains(part)),
            None => Err(wrong("only a text can be in a text")),
        },
        ValueKind::None | ValueKind::Bool | ValueKind::Number => {
            Err(wrong(format!("nothing can be in a `{}`", whole.kind())))
        }
        _ => Ok(whole.try_iter()?.any(|one| numbers::is_equal(&one, part))),
    }
}
