"""Libraries that not every installation needs: which extra of the package brings each, and what it is for."""

from __future__ import annotations

from typing import Final, NamedTuple


class Extra(NamedTuple):
    """A name for `pip install 'qrobot[name]'`, and what works with it alone.

    `distribution` is what brings it, "" where that is called as the module.
    """

    name: str
    purpose: str
    distribution: str = ""

    @property
    def command(self) -> str:
        """The command that installs it."""
        return f"pip install 'qrobot[{self.name}]'"


# By the name of the module that is imported.
EXTRAS: Final = {
    "casadi": Extra("models", "identification, the contact-free plant, and laws written as expressions"),
    "mujoco": Extra("emulator", "the emulated arm", "mujoco-core"),
    "matplotlib": Extra("figures", "figures"),
    "pyarrow": Extra("logs", "Parquet files"),
    "pymodbus": Extra("modbus", "Modbus"),
    "can": Extra("can", "CAN", "python-can"),
    "canopen": Extra("can", "CAN"),
    "lark": Extra("val", "programs in VAL II"),
    "prompt_toolkit": Extra("val", "the monitor of VAL II"),
    "nicegui": Extra("pendant", "the pendant in a browser"),
    "fastapi": Extra("pendant", "the pendant in a browser"),
    "uvicorn": Extra("pendant", "the pendant in a browser"),
    "evdev": Extra("gamepad", "a gamepad or a SpaceMouse"),
    "zenoh": Extra("hosts", "processors of RCI on other hosts", "eclipse-zenoh"),
    "distributed": Extra("study", "campaigns on a Dask scheduler"),
}


def missing_library(module: str) -> str:
    """The sentence for a module of the table that is not installed: what it is for, and what installs it."""
    extra = EXTRAS[module]
    return f"{extra.distribution or module} is not installed, for {extra.purpose}: {extra.command}"


def missing_extra(error: ModuleNotFoundError) -> str | None:
    """The same sentence for a module that was not found; None for a module that no extra brings."""
    module = (error.name or "").partition(".")[0]
    return missing_library(module) if module in EXTRAS else None
