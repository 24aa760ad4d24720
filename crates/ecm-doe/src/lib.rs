//! Designs of informative poses: D-optimal and maximin exchange, with a certificate
