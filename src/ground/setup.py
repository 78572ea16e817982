from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["ground", "ground.verbs"], package_dir={"": "python"}))
