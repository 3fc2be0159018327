//! The messages of jink.xml as Rust, by the generator of the MAVLink project.

use mavlink_bindgen::XmlDefinitions;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let bindings =
        mavlink_bindgen::generate(XmlDefinitions::Files(vec!["jink.xml"]), std::env::var("OUT_DIR")?)?;
    mavlink_bindgen::emit_cargo_build_messages(&bindings);
    Ok(())
}
