//! Barriers of a shader that all threads of a work group are sure to reach: a walk of the module, as strict as browsers
//! are and naga is not.
//!
//! A value is uniform if it is made of constants, the work group's number, uniform buffers, read-only storage at
//! uniform places, and `workgroupUniformLoad`. A local variable is, if all that is ever stored in it is, by all threads
//! alike.

use naga::{
    AddressSpace, Binding, Block, BuiltIn, Expression, Function, Handle, LocalVariable, Module, Statement,
    StorageAccess,
};
use std::collections::HashSet;

/// Faults of a module's barriers, one line each.
pub fn faults(module: &Module) -> Vec<String> {
    let waiting: HashSet<Handle<Function>> = module
        .functions
        .iter()
        .filter(|(_, function)| waits(module, &function.body))
        .map(|(handle, _)| handle)
        .collect();
    let functions = module.functions.iter().map(|(_, function)| function);
    let all = functions.chain(module.entry_points.iter().map(|entry| &entry.function));
    all.flat_map(|function| Walk::of(module, &waiting, function)).collect()
}

/// True if a block has a barrier, in functions that it calls, too.
fn waits(module: &Module, block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::ControlBarrier(_) | Statement::WorkGroupUniformLoad { .. } => true,
        Statement::Call { function, .. } => waits(module, &module.functions[*function].body),
        Statement::Block(block) => waits(module, block),
        Statement::If { accept, reject, .. } => waits(module, accept) || waits(module, reject),
        Statement::Switch { cases, .. } => cases.iter().any(|case| waits(module, &case.body)),
        Statement::Loop { body, continuing, .. } => waits(module, body) || waits(module, continuing),
        _ => false,
    })
}

/// A walk of one function.
struct Walk<'a> {
    module: &'a Module,
    waiting: &'a HashSet<Handle<Function>>,
    function: &'a Function,
    /// Variables that threads may disagree on.
    apart: HashSet<Handle<LocalVariable>>,
    faults: Vec<String>,
}

/// True if threads that come to a place leave it together.
#[derive(Clone, Copy, Default)]
struct Leaves {
    /// Some may leave the innermost loop.
    some_break: bool,
    /// Some may leave the function.
    some_return: bool,
}

impl<'a> Walk<'a> {
    fn of(module: &'a Module, waiting: &'a HashSet<Handle<Function>>, function: &'a Function) -> Vec<String> {
        let mut walk = Walk { module, waiting, function, apart: HashSet::new(), faults: Vec::new() };
        loop {
            let before = walk.apart.len();
            walk.faults.clear();
            walk.block(&function.body, true);
            if walk.apart.len() == before {
                return walk.faults;
            }
        }
    }

    /// Walks a block that is reached by all threads, if `together`.
    fn block(&mut self, block: &Block, together: bool) -> Leaves {
        let mut all = Leaves::default();
        for statement in block {
            let together = together && !all.some_break && !all.some_return;
            let leaves = self.statement(statement, together);
            all.some_break |= leaves.some_break;
            all.some_return |= leaves.some_return;
        }
        all
    }

    fn statement(&mut self, statement: &Statement, together: bool) -> Leaves {
        match statement {
            Statement::ControlBarrier(_) | Statement::WorkGroupUniformLoad { .. } => self.barrier(together),
            Statement::Call { function, .. } if self.waiting.contains(function) => self.barrier(together),
            Statement::Store { pointer, value } => {
                if let Some(variable) = self.local(*pointer)
                    && !(together && self.uniform(*value) && self.uniform_place(*pointer))
                {
                    self.apart.insert(variable);
                }
            }
            Statement::Call { arguments, .. } => {
                // A write through a pointer counts as not uniform.
                let written = arguments.iter().filter_map(|argument| self.local(*argument));
                self.apart.extend(written.collect::<Vec<_>>());
            }
            Statement::Block(block) => return self.block(block, together),
            Statement::If { condition, accept, reject } => {
                let inside = together && self.uniform(*condition);
                let (a, b) = (self.block(accept, inside), self.block(reject, inside));
                return Leaves {
                    some_break: a.some_break || b.some_break,
                    some_return: a.some_return || b.some_return,
                };
            }
            Statement::Switch { selector, cases } => {
                let inside = together && self.uniform(*selector);
                let all = cases.iter().map(|case| self.block(&case.body, inside).some_return);
                let some_return = all.fold(false, |any, this| any | this);
                return Leaves { some_break: false, some_return };
            }
            Statement::Loop { body, continuing, break_if } => {
                return self.repeat(body, continuing, *break_if, together);
            }
            Statement::Break | Statement::Continue => return Leaves { some_break: !together, some_return: false },
            Statement::Return { .. } | Statement::Kill => return Leaves { some_break: false, some_return: !together },
            _ => {}
        }
        Leaves::default()
    }

    /// A loop that threads may leave one by one is walked again as one that they run one by one.
    fn repeat(
        &mut self,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
        together: bool,
    ) -> Leaves {
        let found = self.faults.len();
        let mut inside = together;
        loop {
            self.faults.truncate(found);
            let leaves = self.block(body, inside);
            let stays = inside && !leaves.some_break && !leaves.some_return;
            self.block(continuing, stays);
            let stays = stays && break_if.is_none_or(|condition| self.uniform(condition));
            if stays == inside {
                return Leaves { some_break: false, some_return: leaves.some_return };
            }
            inside = stays;
        }
    }

    fn barrier(&mut self, together: bool) {
        if !together {
            self.faults.push(format!("a barrier in {:?} that some threads may miss", self.function.name));
        }
    }

    /// The local variable that a pointer leads to.
    fn local(&self, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
        match self.function.expressions[pointer] {
            Expression::LocalVariable(variable) => Some(variable),
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => self.local(base),
            _ => None,
        }
    }

    /// True if all threads point to the same place of their variable.
    fn uniform_place(&self, pointer: Handle<Expression>) -> bool {
        match self.function.expressions[pointer] {
            Expression::Access { base, index } => self.uniform(index) && self.uniform_place(base),
            Expression::AccessIndex { base, .. } => self.uniform_place(base),
            _ => true,
        }
    }

    /// True if all threads agree on a value, or on where a pointer leads.
    fn uniform(&self, expression: Handle<Expression>) -> bool {
        match &self.function.expressions[expression] {
            Expression::Literal(_) | Expression::Constant(_) | Expression::Override(_) | Expression::ZeroValue(_) => {
                true
            }
            Expression::WorkGroupUniformLoadResult { .. } => true,
            Expression::FunctionArgument(index) => matches!(
                self.function.arguments[*index as usize].binding,
                Some(Binding::BuiltIn(BuiltIn::WorkGroupId | BuiltIn::NumWorkGroups))
            ),
            Expression::GlobalVariable(variable) => match self.module.global_variables[*variable].space {
                AddressSpace::Uniform => true,
                AddressSpace::Storage { access } => !access.contains(StorageAccess::STORE),
                _ => false,
            },
            Expression::LocalVariable(variable) => !self.apart.contains(variable),
            Expression::Load { pointer } => self.uniform(*pointer),
            Expression::Access { base, index } => self.uniform(*base) && self.uniform(*index),
            Expression::AccessIndex { base, .. } => self.uniform(*base),
            Expression::Splat { value, .. } => self.uniform(*value),
            Expression::Swizzle { vector, .. } => self.uniform(*vector),
            Expression::Compose { components, .. } => components.iter().all(|part| self.uniform(*part)),
            Expression::Unary { expr, .. } | Expression::As { expr, .. } => self.uniform(*expr),
            Expression::Binary { left, right, .. } => self.uniform(*left) && self.uniform(*right),
            Expression::Select { condition, accept, reject } => {
                [condition, accept, reject].into_iter().all(|part| self.uniform(*part))
            }
            Expression::Math { arg, arg1, arg2, arg3, .. } => {
                [Some(*arg), *arg1, *arg2, *arg3].into_iter().flatten().all(|part| self.uniform(part))
            }
            // group_index and the like: as uniform as their arguments.
            Expression::CallResult(_) => self.called(expression),
            _ => false,
        }
    }

    /// True if the call that gave this result had uniform arguments and looks at nothing else.
    fn called(&self, result: Handle<Expression>) -> bool {
        fn find(block: &Block, result: Handle<Expression>) -> Option<(Handle<Function>, &[Handle<Expression>])> {
            block.iter().find_map(|statement| match statement {
                Statement::Call { function, arguments, result: Some(this) } if *this == result => {
                    Some((*function, &arguments[..]))
                }
                Statement::Block(block) => find(block, result),
                Statement::If { accept, reject, .. } => find(accept, result).or_else(|| find(reject, result)),
                Statement::Loop { body, continuing, .. } => find(body, result).or_else(|| find(continuing, result)),
                Statement::Switch { cases, .. } => cases.iter().find_map(|case| find(&case.body, result)),
                _ => None,
            })
        }
        let Some((function, arguments)) = find(&self.function.body, result) else { return false };
        let pure = self.module.functions[function].expressions.iter().all(|(_, expression)| {
            !matches!(expression, Expression::GlobalVariable(variable)
                if self.module.global_variables[*variable].space != AddressSpace::Uniform)
        });
        pure && arguments.iter().all(|argument| self.uniform(*argument))
    }
}
