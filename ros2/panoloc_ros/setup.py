"""Installs the node as an ament_python package."""

from pathlib import Path

from setuptools import setup

NAME = "panoloc_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", [str(file) for file in Path("launch").glob("*.py")]),
        (f"share/{NAME}/config", [str(file) for file in Path("config").glob("*.yaml")]),
        (f"share/{NAME}/rviz", [str(file) for file in Path("rviz").glob("*.rviz")]),
    ],
    install_requires=["setuptools", "panoloc-mcl"],
    zip_safe=True,
    description="Global localization of a robot with a panoramic camera, in the place of AMCL",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"panoloc_node = {NAME}.node:main"]},
)
