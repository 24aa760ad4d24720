//! VTK's XML for unstructured grids (VTK file formats, ASCII), for ParaView.

use crate::FemError;
use crate::body::{Body, Field};
use crate::tensor::{product, symmetric_eigenvalues, transpose};
use std::fmt::Write;

/// VTK's number of the ten-node tetrahedron; its mid-edge order is ours.
const QUADRATIC_TETRAHEDRON: usize = 24;

/// The text of a `.vtu` file: undeformed nodes with `displacement_m`; per element the
/// means `largest_stretch`, `jacobian`, Cauchy stress `stress_Pa` (9 components) and
/// `von_mises_Pa`.
///
/// # Errors
/// A field that is not of this body.
pub fn vtu(body: &Body, field: &Field) -> Result<String, FemError> {
    let rest = body.rest();
    for (what, found, expected) in [
        (
            "the displacement of a field",
            &field.displacement,
            &rest.displacement,
        ),
        ("the pressure of a field", &field.pressure, &rest.pressure),
    ] {
        if found.len() != expected.len() {
            return Err(FemError::Size {
                what,
                found: found.len(),
                expected: expected.len(),
                why: "as many as this body has",
            });
        }
    }
    let mesh = &body.mesh;
    let (nodes, elements) = (mesh.nodes_m().len(), mesh.tetrahedra().len());
    let mut cells = [String::new(), String::new(), String::new(), String::new()];
    for e in 0..elements {
        let (mut stretch, mut jacobian, mut sigma, mut count) = (0.0, 0.0, [0.0; 9], 0.0);
        for (f, s) in body
            .deformation_gradients(e, field)
            .zip(body.cauchy_stress_Pa(e, field))
        {
            let c = product(&transpose(&f), &f);
            stretch += symmetric_eigenvalues(&c)[2].sqrt();
            jacobian += crate::tensor::determinant(&f);
            for (sum, value) in sigma.iter_mut().zip(s.iter().flatten()) {
                *sum += value;
            }
            count += 1.0;
        }
        let sigma = sigma.map(|s| s / count);
        let mean = (sigma[0] + sigma[4] + sigma[8]) / 3.0;
        let squared: f64 = (0..9)
            .map(|r| sigma[r] - if r % 4 == 0 { mean } else { 0.0 })
            .map(|s| s * s)
            .sum();
        line(&mut cells[0], &[stretch / count]);
        line(&mut cells[1], &[jacobian / count]);
        line(&mut cells[2], &sigma);
        line(&mut cells[3], &[(1.5 * squared).sqrt()]);
    }
    let mut points = String::new();
    let mut moved = String::new();
    for (x, u) in mesh
        .nodes_m()
        .iter()
        .zip(field.displacement.chunks_exact(3))
    {
        line(&mut points, x);
        line(&mut moved, u);
    }
    let (mut connectivity, mut offsets, mut types) = (String::new(), String::new(), String::new());
    for (e, tet) in mesh.tetrahedra().iter().enumerate() {
        let words: Vec<String> = tet.iter().map(ToString::to_string).collect();
        connectivity.push_str(&words.join(" "));
        connectivity.push('\n');
        let _ = writeln!(offsets, "{}", 10 * (e + 1));
        let _ = writeln!(types, "{QUADRATIC_TETRAHEDRON}");
    }
    let array = |kind: &str, name: &str, components: usize, content: &str| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"ascii\">\n{content}</DataArray>\n"
        )
    };
    let parts = [
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\">\n".into(),
        format!(
            "<UnstructuredGrid>\n<Piece NumberOfPoints=\"{nodes}\" NumberOfCells=\"{elements}\">\n"
        ),
        format!(
            "<Points>\n{}</Points>\n<Cells>\n",
            array("Float64", "points_m", 3, &points)
        ),
        array("Int64", "connectivity", 1, &connectivity),
        array("Int64", "offsets", 1, &offsets),
        array("UInt8", "types", 1, &types),
        "</Cells>\n<PointData Vectors=\"displacement_m\">\n".into(),
        array("Float64", "displacement_m", 3, &moved),
        "</PointData>\n<CellData Scalars=\"largest_stretch\">\n".into(),
        array("Float64", "largest_stretch", 1, &cells[0]),
        array("Float64", "jacobian", 1, &cells[1]),
        array("Float64", "stress_Pa", 9, &cells[2]),
        array("Float64", "von_mises_Pa", 1, &cells[3]),
        "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n".into(),
    ];
    Ok(parts.concat())
}

fn line(text: &mut String, values: &[f64]) {
    let words: Vec<String> = values.iter().map(|v| format!("{v:e}")).collect();
    text.push_str(&words.join(" "));
    text.push('\n');
}
