from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import find_packages, setup

packages = find_packages("python")
data = {"": ["py.typed", "*.html", "*.js", "*.css", "*.jinja", "*.json"]}
setup(**generate_distutils_setup(packages=packages, package_dir={"": "python"}, package_data=data))
