"""The samples go into the wheel as data of `ddgcli.samples`; everything else is in pyproject.toml."""

from setuptools import find_packages, setup

SAMPLES = {"ddgcli.samples.meshes": "sample_meshes", "ddgcli.samples.scenes": "sample_scenes"}

setup(
    packages=[*find_packages(include=["ddgcli*"]), *SAMPLES],
    package_dir=SAMPLES,
    package_data={"ddgcli": ["py.typed"], "ddgcli.plots": ["viewer.html"]}
    | {name: ["*"] for name in SAMPLES},
)
