from glob import glob

from setuptools import find_packages, setup

package_name = 'mambo_bringup'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', sorted(glob('launch/*.*'))),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='Launch files, parameters, scenarios and the flight runner of the Mambo twin.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'check_node = mambo_ros.entry:mambo_bringup.checking.check_node',
            'composed_node = mambo_ros.entry:mambo_bringup.composed_node',
            'fly = mambo_bringup.run:main',
            'hall_capture_node = mambo_ros.entry:mambo_bringup.hall_capture_node',
            'replay = mambo_bringup.replay:main',
        ],
    },
)
