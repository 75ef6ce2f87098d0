//! Schedules: order, priority, resuming.

use proptest::prelude::*;
use weaver_compression::Schedule;

proptest! {
    #[test]
    fn tasks_come_by_step_priority_and_order(tasks in prop::collection::vec((0_usize..6, -2_i32..3), 0..20), start in 0_usize..6) {
        let numbered: Vec<(usize, i32, usize)> = tasks.iter().zip(0..).map(|(&(step, priority), i)| (step, priority, i)).collect();
        let mut schedule = Schedule::new(numbered.clone());
        schedule.go_on(start);
        let mut found = Vec::new();
        for step in 0..7 {
            prop_assert!(schedule.next_step().is_none_or(|next| next >= step));
            found.extend(schedule.take_due(step).into_iter().map(|task| (step, numbered[task].1, task)));
        }
        // Going on at a step gives the rest of the whole run from there.
        let mut expected: Vec<_> = numbered.into_iter().filter(|(step, ..)| *step >= start).collect();
        expected.sort_unstable();
        prop_assert_eq!(found, expected);
        prop_assert_eq!(schedule.next_step(), None);
    }
}
