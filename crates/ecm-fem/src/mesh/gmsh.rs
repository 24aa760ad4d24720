//! Gmsh 4.1 ASCII files (reference manual, section "MSH file format").

use super::{Mesh, quadratic};
use crate::FemError;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Tokens of a file with their line numbers.
struct Words<'a> {
    path: String,
    words: std::iter::Peekable<std::vec::IntoIter<(usize, &'a str)>>,
    line: usize,
}

impl<'a> Words<'a> {
    fn fail<T>(
        &self,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Result<T, FemError> {
        Err(FemError::MeshFile {
            path: self.path.clone(),
            line: self.line,
            found: found.into(),
            expected: expected.into(),
        })
    }

    fn word(&mut self, expected: &str) -> Result<&'a str, FemError> {
        match self.words.next() {
            Some((line, word)) => {
                self.line = line;
                Ok(word)
            }
            None => self.fail("the end of the file", expected),
        }
    }

    fn number<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T, FemError> {
        let word = self.word(expected)?;
        word.parse()
            .or_else(|_| self.fail(format!("\"{word}\""), expected))
    }

    fn skip(&mut self, count: usize, expected: &str) -> Result<(), FemError> {
        for _ in 0..count {
            self.word(expected)?;
        }
        Ok(())
    }

    /// A quoted name, which may hold spaces.
    fn name(&mut self) -> Result<String, FemError> {
        let mut name = self.word("a physical name in quotes")?.to_string();
        while !(name.len() > 1 && name.ends_with('"')) {
            let more = self.word("a closing quote")?;
            name.push(' ');
            name.push_str(more);
        }
        Ok(name.trim_matches('"').to_string())
    }
}

#[derive(Default)]
struct File {
    /// By dimension and physical tag.
    names: BTreeMap<(usize, i64), String>,
    /// Physical tags by dimension and entity.
    groups: HashMap<(usize, i64), Vec<i64>>,
    nodes: Vec<[f64; 3]>,
    index_of_tag: HashMap<u64, usize>,
    tets: Vec<Vec<usize>>,
    faces: BTreeMap<String, Vec<usize>>,
    regions: BTreeMap<String, Vec<usize>>,
}

/// Reads linear (type 4, 2) or quadratic (type 11, 9) tetrahedra and triangles.
pub fn read(path: &Path) -> Result<Mesh, FemError> {
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|e| FemError::Unreadable {
        path: shown.clone(),
        reason: e.to_string(),
    })?;
    parse(&shown, &text)
}

/// [`read`] on the text itself; `path` only names it in messages.
pub fn parse(path: &str, text: &str) -> Result<Mesh, FemError> {
    let tokens: Vec<(usize, &str)> = text
        .lines()
        .enumerate()
        .flat_map(|(i, line)| line.split_whitespace().map(move |w| (i + 1, w)))
        .collect();
    let mut words = Words {
        path: path.into(),
        words: tokens.into_iter().peekable(),
        line: 1,
    };
    let mut file = File::default();
    let mut format_seen = false;
    while words.words.peek().is_some() {
        let section = words.word("a section")?;
        if !section.starts_with('$') {
            return words.fail(format!("\"{section}\""), "a section such as $MeshFormat");
        }
        match section {
            "$MeshFormat" => {
                format(&mut words)?;
                format_seen = true;
            }
            _ if !format_seen => {
                return words.fail(section, "$MeshFormat first: a Gmsh 4.1 ASCII file");
            }
            "$PhysicalNames" => physical_names(&mut words, &mut file)?,
            "$Entities" => entities(&mut words, &mut file)?,
            "$Nodes" => nodes(&mut words, &mut file)?,
            "$Elements" => elements(&mut words, &mut file)?,
            _ => {
                let end = section.replacen('$', "$End", 1);
                while words.word(&end)? != end {}
                continue;
            }
        }
        let end = section.replacen('$', "$End", 1);
        let found = words.word(&end)?;
        if found != end {
            return words.fail(format!("\"{found}\""), end);
        }
    }
    build(&words, file)
}

fn format(words: &mut Words) -> Result<(), FemError> {
    let version = words.word("the version 4.1")?;
    if version != "4.1" {
        return words.fail(
            format!("format version {version}"),
            "4.1; save with `gmsh -format msh41` or Mesh.MshFileVersion = 4.1",
        );
    }
    let binary: u32 = words.number("0 for ASCII")?;
    if binary != 0 {
        return words.fail("a binary file", "ASCII; save with Mesh.Binary = 0");
    }
    words.skip(1, "the data size")
}

fn physical_names(words: &mut Words, file: &mut File) -> Result<(), FemError> {
    let count: usize = words.number("the number of physical names")?;
    for _ in 0..count {
        let dimension: usize = words.number("a dimension")?;
        let tag: i64 = words.number("a physical tag")?;
        file.names.insert((dimension, tag), words.name()?);
    }
    Ok(())
}

fn entities(words: &mut Words, file: &mut File) -> Result<(), FemError> {
    let mut counts = [0usize; 4];
    for count in &mut counts {
        *count = words.number("a number of entities")?;
    }
    for (dimension, &count) in counts.iter().enumerate() {
        for _ in 0..count {
            let tag: i64 = words.number("an entity tag")?;
            words.skip(
                if dimension == 0 { 3 } else { 6 },
                "coordinates of an entity",
            )?;
            let groups: usize = words.number("the number of physical tags")?;
            let mut tags = Vec::new();
            for _ in 0..groups {
                tags.push(words.number::<i64>("a physical tag")?);
            }
            if dimension > 0 {
                let bounding: usize = words.number("the number of bounding entities")?;
                words.skip(bounding, "a bounding entity")?;
            }
            file.groups.insert((dimension, tag), tags);
        }
    }
    Ok(())
}

fn nodes(words: &mut Words, file: &mut File) -> Result<(), FemError> {
    let blocks: usize = words.number("the number of node blocks")?;
    words.skip(3, "node counts")?;
    for _ in 0..blocks {
        words.skip(2, "an entity")?;
        let parametric: u32 = words.number("0 or 1")?;
        if parametric != 0 {
            return words.fail("parametric nodes", "0; save with Mesh.SaveParametric = 0");
        }
        let count: usize = words.number("the number of nodes in the block")?;
        let mut tags = Vec::new();
        for _ in 0..count {
            tags.push(words.number::<u64>("a node tag")?);
        }
        for tag in tags {
            let mut x = [0.0; 3];
            for value in &mut x {
                *value = words.number("a coordinate")?;
            }
            if file.index_of_tag.insert(tag, file.nodes.len()).is_some() {
                return words.fail(format!("node {tag} a second time"), "each node once");
            }
            file.nodes.push(x);
        }
    }
    Ok(())
}

fn elements(words: &mut Words, file: &mut File) -> Result<(), FemError> {
    let blocks: usize = words.number("the number of element blocks")?;
    words.skip(3, "element counts")?;
    for _ in 0..blocks {
        let dimension: usize = words.number("a dimension")?;
        let entity: i64 = words.number("an entity tag")?;
        let kind: u32 = words.number("an element type")?;
        let count: usize = words.number("the number of elements in the block")?;
        let size = match kind {
            15 => 1,
            1 => 2,
            8 => 3,
            2 => 3,
            9 => 6,
            4 => 4,
            11 => 10,
            _ => {
                return words.fail(
                    format!("element type {kind}"),
                    "tetrahedra (type 4 or 11) and triangles (type 2 or 9) only",
                );
            }
        };
        if dimension == 3 && !matches!(kind, 4 | 11) {
            return words.fail(
                format!("element type {kind} in a volume"),
                "tetrahedra (type 4 or 11) there; save with Mesh.SaveAll = 0",
            );
        }
        let groups = file.groups.get(&(dimension, entity)).into_iter().flatten();
        let named: Vec<String> = groups
            .filter_map(|group| file.names.get(&(dimension, *group)).cloned())
            .collect();
        for _ in 0..count {
            words.skip(1, "an element tag")?;
            let mut list = Vec::with_capacity(size);
            for _ in 0..size {
                let tag: u64 = words.number("a node tag")?;
                match file.index_of_tag.get(&tag) {
                    Some(&node) => list.push(node),
                    None => return words.fail(format!("node {tag}"), "a node of $Nodes"),
                }
            }
            if dimension == 3 {
                for name in &named {
                    let region = file.regions.entry(name.clone()).or_default();
                    region.push(file.tets.len());
                }
                file.tets.push(list);
            } else if dimension == 2 {
                for name in &named {
                    file.faces.entry(name.clone()).or_default().extend(&list);
                }
            }
        }
    }
    Ok(())
}

fn build(words: &Words, mut file: File) -> Result<Mesh, FemError> {
    if file.tets.is_empty() {
        return words.fail(
            "no tetrahedra",
            "a volume mesh (gmsh -3), saved with its physical volume",
        );
    }
    let quadratic_file = file.tets[0].len() == 10;
    if file.tets.iter().any(|t| (t.len() == 10) != quadratic_file) {
        return words.fail("linear and quadratic tetrahedra mixed", "one element order");
    }
    let mut faces = Vec::new();
    for name in ["base", "top"] {
        let Some(mut list) = file.faces.remove(name) else {
            let surfaces = file
                .names
                .iter()
                .filter(|((dimension, _), _)| *dimension == 2);
            let known: Vec<&str> = surfaces.map(|(_, name)| name.as_str()).collect();
            let found = if known.is_empty() {
                "none".into()
            } else {
                known.join(", ")
            };
            return Err(FemError::MissingFace { name, found });
        };
        list.sort_unstable();
        list.dedup();
        faces.push(list);
    }
    let mut named: Vec<(String, Vec<usize>)> = (file.faces.into_iter())
        .filter(|(name, _)| name.starts_with("chamber") || name.starts_with("winding"))
        .collect();
    for (_, list) in &mut named {
        list.sort_unstable();
        list.dedup();
    }
    let tets = if quadratic_file {
        // Gmsh numbers its last two mid-edge nodes 23, 13.
        file.tets
            .iter()
            .map(|t| [t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[9], t[8]])
            .collect()
    } else {
        let corners: Vec<[usize; 4]> = file.tets.iter().map(|t| [t[0], t[1], t[2], t[3]]).collect();
        let tets = quadratic::raise(&mut file.nodes, &corners, |a, b, x| {
            [0, 1, 2].map(|k| 0.5 * (x[a][k] + x[b][k]))
        });
        for list in &mut faces {
            let middle = quadratic::mid_nodes_of_faces(&tets, list);
            list.extend(middle);
        }
        for (_, list) in &mut named {
            let middle = quadratic::mid_nodes_of_faces(&tets, list);
            list.extend(middle);
        }
        tets
    };
    let top = faces.pop().unwrap_or_default();
    let base = faces.pop().unwrap_or_default();
    let mut mesh = Mesh::new(file.nodes, tets, base, top)?;
    for (name, tetrahedra) in file.regions {
        mesh = mesh.with_region(&name, tetrahedra)?;
    }
    (named.into_iter()).try_fold(mesh, |mesh, (name, nodes)| {
        match name.starts_with("chamber") {
            true => mesh.with_chamber(&name, nodes),
            false => mesh.with_surface(&name, nodes),
        }
    })
}
