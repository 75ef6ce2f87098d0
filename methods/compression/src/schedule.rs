//! Tasks due at certain steps.

/// Tasks by step and priority.
///
/// Tasks of one step are done by ascending priority, of equal priority in their given order. A run that [goes
/// on](Self::go_on) at a later step leaves out earlier ones.
///
/// ```
/// use weaver_compression::Schedule;
///
/// let mut schedule = Schedule::new(vec![(20, 0, "measure"), (10, 1, "train"), (10, 0, "prune")]);
/// assert_eq!(schedule.next_step(), Some(10));
/// assert_eq!(schedule.take_due(10), ["prune", "train"]);
/// assert!(schedule.take_due(15).is_empty());
/// assert_eq!(schedule.take_due(20), ["measure"]);
/// ```
#[derive(Clone, Debug)]
pub struct Schedule<T> {
    /// Step and task, the next one last.
    tasks: Vec<(usize, T)>,
}

impl<T> Default for Schedule<T> {
    /// An empty schedule.
    fn default() -> Self {
        Self { tasks: Vec::new() }
    }
}

impl<T> Schedule<T> {
    /// A schedule of `(step, priority, task)`.
    pub fn new(mut tasks: Vec<(usize, i32, T)>) -> Self {
        tasks.sort_by_key(|&(step, priority, _)| (step, priority));
        Self { tasks: tasks.into_iter().rev().map(|(step, _, task)| (step, task)).collect() }
    }

    /// Leaves out the tasks before a step, for a resumed run.
    pub fn go_on(&mut self, start: usize) {
        self.tasks.retain(|(step, _)| *step >= start);
    }

    /// The step of the next task.
    pub fn next_step(&self) -> Option<usize> {
        self.tasks.last().map(|(step, _)| *step)
    }

    /// Removes and returns the tasks of this step, in their order.
    pub fn take_due(&mut self, step: usize) -> Vec<T> {
        let due = self.tasks.iter().rev().take_while(|(at, _)| *at == step).count();
        self.tasks.drain(self.tasks.len() - due..).rev().map(|(_, task)| task).collect()
    }
}
