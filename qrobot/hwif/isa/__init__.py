"""The transport to a TRC004 board behind a TRC006 card on the ISA bus: port instructions inside compiled code."""
