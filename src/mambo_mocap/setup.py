from setuptools import find_packages, setup

package_name = 'mambo_mocap'

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
    description='NatNet: a server for the simulated hall and a client for real halls.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'natnet_client_node = mambo_ros.entry:mambo_mocap.natnet_client_node',
            'natnet_server_node = mambo_ros.entry:mambo_mocap.natnet_server_node',
        ],
    },
)
