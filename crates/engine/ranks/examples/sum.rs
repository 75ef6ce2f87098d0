//! Passes numbers from each process to the first: `mpirun -n 3 cargo run -p weaver-ranks --features mpi --example sum`.

use weaver_ranks::Processes;

fn main() {
    let Some(processes) = Processes::launched() else {
        println!("start this by mpirun");
        return;
    };
    let ranks = processes.ranks();
    let mut value = [1.0 + ranks.rank() as f32];
    if ranks.rank() > 0 {
        ranks.send(&value, 0);
    }
    for other in (1..ranks.size()).filter(|_| ranks.rank() == 0) {
        let mut theirs = [0.0];
        ranks.receive(&mut theirs, other);
        value[0] += theirs[0];
    }
    ranks.broadcast(&mut value);
    println!("process {} of {}: {}", ranks.rank(), ranks.size(), value[0]);
}
