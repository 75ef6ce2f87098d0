//! The studies as a program: `weaver-studies STUDY ARGUMENTS`.

fn main() -> weaver_studies::Outcome {
    weaver_studies::run(std::env::args().skip(1))
}
