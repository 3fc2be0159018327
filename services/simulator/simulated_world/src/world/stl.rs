//! Reads triangles from STL files, binary or text. Source: 3D Systems, "Stereolithography Interface Specification", 1988.

use super::spec::WorldError;

/// Bytes before the triangles of a binary file, their number included.
const HEAD: usize = 84;
/// Bytes of one triangle: normal, three corners, a spare number.
const TRIANGLE: usize = 50;

/// Corners of a triangle, as in the file.
pub type Triangle = [[f64; 3]; 3];

/// The triangles of a file; `name` appears in errors.
///
/// # Errors
/// [`WorldError::File`] saying what is wrong.
pub fn parse(name: &str, bytes: &[u8]) -> Result<Vec<Triangle>, WorldError> {
    let wrong = |message: String| WorldError::File {
        file: name.to_owned(),
        message,
    };
    // A binary file may begin with "solid", too; its length decides.
    let triangles = match binary(bytes) {
        Some(triangles) => triangles,
        None if bytes.starts_with(b"solid") => text(bytes).map_err(wrong)?,
        None => {
            return Err(wrong(
                "it is no STL file: neither of the length that its header says, nor does it begin with \"solid\"".to_owned(),
            ));
        }
    };
    let is_finite = |triangle: &Triangle| triangle.iter().flatten().all(|number| number.is_finite());
    if triangles.is_empty() || !triangles.iter().all(is_finite) {
        return Err(wrong(
            "it has no triangles, or corners that are no numbers".to_owned(),
        ));
    }
    Ok(triangles)
}

fn binary(bytes: &[u8]) -> Option<Vec<Triangle>> {
    let count = u32::from_le_bytes(bytes.get(HEAD - 4..HEAD)?.try_into().ok()?);
    let body = &bytes[HEAD..];
    if body.len() != usize::try_from(count).ok()?.checked_mul(TRIANGLE)? {
        return None;
    }
    let number = |chunk: &[u8], at: usize| {
        let bytes = [chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]];
        f64::from(f32::from_le_bytes(bytes))
    };
    let corner =
        |chunk: &[u8], corner: usize| std::array::from_fn(|axis| number(chunk, 12 + 12 * corner + 4 * axis));
    let triangle = |chunk: &[u8]| [corner(chunk, 0), corner(chunk, 1), corner(chunk, 2)];
    Some(body.chunks_exact(TRIANGLE).map(triangle).collect())
}

fn text(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "its text is not UTF-8".to_owned())?;
    let mut corners = Vec::new();
    for (line, words) in (1..).zip(text.lines()) {
        let Some(numbers) = words.trim_start().strip_prefix("vertex") else {
            continue;
        };
        let mut numbers = numbers.split_whitespace().map(str::parse::<f64>);
        let corner = [numbers.next(), numbers.next(), numbers.next()];
        let [Some(Ok(x)), Some(Ok(y)), Some(Ok(z))] = corner else {
            return Err(format!("line {line}: a vertex has three numbers"));
        };
        corners.push([x, y, z]);
    }
    let (triangles, rest) = corners.as_chunks::<3>();
    if rest.is_empty() {
        Ok(triangles.to_vec())
    } else {
        Err(format!("{} corners are no whole triangles", corners.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::parse;
    use proptest::prelude::*;

    fn binary(triangles: &[[f32; 12]]) -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes[..5].copy_from_slice(b"solid");
        bytes.extend(u32::try_from(triangles.len()).unwrap().to_le_bytes());
        for triangle in triangles {
            bytes.extend(triangle.iter().flat_map(|number| number.to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn both_kinds_of_file_say_the_same() {
        let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 2.0, 0.25];
        let text = "solid x\nfacet normal 0 0 1\nouter loop\n vertex 0 0 0\n vertex 1.5 0 0\n vertex 0 2 2.5e-1\nendloop\nendfacet\n";
        let expected = vec![[[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.0, 0.25]]];
        assert_eq!(parse("x.stl", &binary(&[numbers])).unwrap(), expected);
        assert_eq!(parse("x.stl", text.as_bytes()).unwrap(), expected);
    }

    #[test]
    fn what_is_no_mesh_is_refused_with_its_name() {
        let cut = binary(&[[0.0; 12]]);
        let nan = binary(&[[f32::NAN; 12]]);
        let cases: [(&[u8], &str); 5] = [
            (b"hello", "no STL file"),
            (&cut[5..cut.len() - 1], "no STL file"),
            (&nan, "no numbers"),
            (b"solid\nvertex 1 2\n", "line 2: a vertex has three numbers"),
            (b"solid\nvertex 1 2 3\n", "no whole triangles"),
        ];
        for (bytes, words) in cases {
            let error = parse("x.stl", bytes).unwrap_err().to_string();
            assert!(error.starts_with("x.stl: ") && error.contains(words), "{error}");
        }
    }

    proptest! {
        #[test]
        fn garbage_is_refused_and_never_fatal(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _refused = parse("x.stl", &bytes);
        }
    }
}
