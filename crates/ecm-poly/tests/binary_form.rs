//! Energies in binary form: the same wrench after the way through bytes; no bytes make it panic.
#![allow(clippy::unwrap_used, missing_docs)]

use ecm_poly::energy::EnergyTables;
use ecm_poly::energy::binary::{BinaryError, EnergyMemory};
use ecm_poly::energy::terms::terms;
use ecm_poly::{EnergyModel, Pose, Symmetry};
use proptest::prelude::*;

type Memory = EnergyMemory<f64, 256, 4096>;

fn model(symmetry: Symmetry, degree: usize) -> EnergyModel {
    let count = terms(symmetry, degree).unwrap().len();
    let weights: Vec<f64> = (0..count)
        .map(|i| ((i as f64 + 1.0) * 12.9898).sin())
        .collect();
    EnergyModel::from_coefficients(0.1034, degree, symmetry, [0.03, 0.9], &weights).unwrap()
}

/// The bytes with the right checksum, so that what lies behind it is tried.
fn summed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len() - 4;
    let mut sum = u32::MAX;
    for byte in &bytes[..body] {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg());
        }
    }
    bytes.truncate(body);
    bytes.extend((!sum).to_le_bytes());
    bytes
}

#[test]
fn the_way_through_bytes_changes_no_wrench() {
    let pose = Pose::from_array(&[0.101, 0.004, -0.003, 0.1, 0.2, -0.3]).unwrap();
    for (symmetry, degree) in [
        (Symmetry::Alike, 4),
        (Symmetry::Revolution, 4),
        (Symmetry::Alike, 6),
        (Symmetry::General, 3),
    ] {
        let model = model(symmetry, degree);
        let bytes = model.to_bytes::<f64>().unwrap();
        let tables = model.tables::<f64>().unwrap();
        let plan = tables.plan::<256>().unwrap();
        let memory = Memory::from_bytes(&bytes).unwrap();
        let owned = EnergyTables::<f64>::from_bytes(&bytes).unwrap();
        assert_eq!(owned.to_bytes([1.0, 2.0]), tables.to_bytes([1.0, 2.0]));
        let expected = plan.wrench::<ecm_poly::arithmetic::Plain>(&pose);
        assert_eq!(memory.wrench(&pose), expected);
        assert_eq!(memory.wrench_and_stiffness(&pose).0, expected);
        assert!(memory.inside(&pose));
        assert!(!memory.inside(&Pose::from_array(&[0.2, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap()));
        let single = EnergyMemory::<f32, 256, 4096>::from_bytes(&model.to_bytes::<f32>().unwrap());
        let narrow = Pose::from_array(&pose.to_array().map(|x| x as f32)).unwrap();
        let largest = expected.force.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (a, b) in single
            .unwrap()
            .wrench(&narrow)
            .force
            .iter()
            .zip(expected.force)
        {
            assert!((f64::from(*a) - b).abs() < 1e-3 * largest);
        }
    }
}

#[test]
fn wrong_bytes_are_refused_with_their_reason() {
    let bytes = model(Symmetry::Alike, 4).to_bytes::<f32>().unwrap();
    let refusal = |bytes: &[u8]| Memory::from_bytes(bytes).unwrap_err();
    assert!(matches!(
        refusal(&bytes[..20]),
        BinaryError::Length { expected: 36, .. }
    ));
    assert!(matches!(
        refusal(&bytes[..bytes.len() - 1]),
        BinaryError::Length { .. }
    ));
    let with = |at: usize, value: u8| {
        let mut changed = bytes.clone();
        changed[at] = value;
        changed
    };
    assert_eq!(refusal(&with(0, b'X')), BinaryError::Format);
    assert_eq!(refusal(&with(4, 2)), BinaryError::Version(2));
    assert_eq!(refusal(&with(6, 9)), BinaryError::Head);
    assert_eq!(refusal(&with(60, bytes[60] ^ 1)), BinaryError::Sum);
    assert_eq!(refusal(&summed(with(15, 0xff))), BinaryError::Number);
    assert!(matches!(
        refusal(&summed(with(37, 0xff))),
        BinaryError::Tables(_)
    ));
    let small = EnergyMemory::<f32, 16, 4096>::from_bytes(&bytes).unwrap_err();
    assert!(matches!(
        small,
        BinaryError::Memory {
            name: "monomials",
            limit: 16,
            ..
        }
    ));
    let few = EnergyMemory::<f32, 256, 8>::from_bytes(&bytes).unwrap_err();
    assert!(few.to_string().contains("the memory holds 8"));
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(Memory::from_bytes(&bytes).is_err());
        prop_assert!(EnergyTables::<f32>::from_bytes(&bytes).is_err());
    }

    #[test]
    fn changed_bytes_with_a_right_checksum_do_not_make_it_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = model(Symmetry::Alike, 3).to_bytes::<f32>().unwrap();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let bytes = summed(bytes);
        let pose = Pose::from_array(&[0.1, 0.01, 0.0, 0.1, 0.2, 0.3]).unwrap();
        if let Ok(memory) = Memory::from_bytes(&bytes) {
            memory.wrench_and_stiffness(&pose);
            memory.inside(&pose);
        }
        if let Ok(tables) = EnergyTables::<f64>::from_bytes(&bytes) {
            let plan = tables.plan::<4096>().unwrap();
            plan.energy::<ecm_poly::arithmetic::Plain>(&pose);
        }
    }
}
