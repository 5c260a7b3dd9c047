from glob import glob

from setuptools import find_packages, setup

package_name = 'mambo_description'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['meshes/*.stl']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/meshes', sorted(glob(f'{package_name}/meshes/*.stl'))),
        (f'share/{package_name}/urdf', sorted(glob('urdf/*'))),
        (f'share/{package_name}/rviz', sorted(glob('rviz/*'))),
        (f'share/{package_name}/layouts', sorted(glob('layouts/*'))),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='URDF, meshes, static frames and layouts of the Mambo for RViz and other viewers.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'description_node = mambo_ros.entry:mambo_description.description_node',
        ],
    },
)
