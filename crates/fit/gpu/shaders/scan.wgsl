// Running sums over the 256 threads of a work group (Hillis and Steele).

var<workgroup> running: array<u32, 256>;

fn add(a: u32, b: u32) -> u32 {
    return min(a + b, MOST);
}

// The sum of x over this thread and those before it. All threads must come here.
fn scan(lane: u32, x: u32) -> u32 {
    var sum = x;
    running[lane] = x;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        if (lane >= step) {
            sum = add(sum, running[lane - step]);
        }
        workgroupBarrier();
        running[lane] = sum;
        workgroupBarrier();
    }
    return sum;
}

// The sum over all threads, after a scan.
fn total() -> u32 {
    return running[255];
}
