//! Threads of one process in the place of processes.

use crate::Ranks;
use std::fmt::{self, Debug, Formatter};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A message of numbers, or a word.
type Message = (Vec<f32>, u64);

/// One of several threads, with a channel from and to each of them.
struct Thread {
    rank: usize,
    to: Mutex<Vec<Sender<Message>>>,
    from: Mutex<Vec<Receiver<Message>>>,
}

/// Ranks for so many threads of this process, in the order of their numbers: a run of several processes to test with.
///
/// A thread that ends while others wait for it ends them by a panic.
pub fn threads(count: usize) -> Vec<Arc<dyn Ranks>> {
    let mut senders: Vec<Vec<_>> = (0..count).map(|_| Vec::new()).collect();
    let mut receivers: Vec<Vec<_>> = (0..count).map(|_| Vec::new()).collect();
    for receivers in &mut receivers {
        for senders in &mut senders {
            let (sender, receiver) = channel();
            senders.push(sender);
            receivers.push(receiver);
        }
    }
    let thread = |(rank, (to, from))| -> Arc<dyn Ranks> {
        Arc::new(Thread { rank, to: Mutex::new(to), from: Mutex::new(from) })
    };
    senders.into_iter().zip(receivers).enumerate().map(thread).collect()
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Debug for Thread {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "Thread {}", self.rank)
    }
}

impl Thread {
    fn put(&self, message: Message, to: usize) {
        locked(&self.to)[to].send(message).expect("a thread that has not ended");
    }

    fn take(&self, from: usize) -> Message {
        locked(&self.from)[from].recv().expect("a thread that has not ended")
    }
}

impl Ranks for Thread {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        locked(&self.to).len()
    }

    fn send(&self, values: &[f32], to: usize) {
        self.put((values.to_vec(), 0), to);
    }

    fn receive(&self, values: &mut [f32], from: usize) {
        values.copy_from_slice(&self.take(from).0);
    }

    fn broadcast(&self, values: &mut [f32]) {
        if self.rank == 0 {
            (1..self.size()).for_each(|to| self.send(values, to));
        } else {
            self.receive(values, 0);
        }
    }

    fn gather(&self, word: u64) -> Vec<u64> {
        (0..self.size()).for_each(|to| self.put((Vec::new(), word), to));
        (0..self.size()).map(|from| self.take(from).1).collect()
    }
}
