from setuptools import find_packages, setup

package_name = 'mambo_sim'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='Plant and sensors; nodes that simulate, mock the mocap, record and replay.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'optitrack_node = mambo_ros.entry:mambo_sim.optitrack_node',
            'recorder_node = mambo_ros.entry:mambo_bags.recorder_node',
            'replay_node = mambo_ros.entry:mambo_bags.replay_node',
            'sim_node = mambo_ros.entry:mambo_sim.sim_node',
        ],
    },
)
