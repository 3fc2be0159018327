//! A lidar as a process; as a tool, the returns in a recording as a table.

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((_, rest)) = arguments.split_first().filter(|(first, _)| *first == "dump") {
        return jink_lidar_driver::dump::run(rest);
    }
    jink_runtime::device::run::<jink_lidar_driver::LidarService>()
}
