//! The supervisor alone, for tests of it with processes that are not jink's.

fn main() -> std::process::ExitCode {
    jink_supervisor::program::main()
}
