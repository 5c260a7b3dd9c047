from setuptools import find_packages, setup

package_name = 'mambo_flight'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['scenarios/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='One flight as data, flown in one process: scenarios, closed loop, sweeps.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'check_trajectory = mambo_flight.course.check_course:main',
            'consistency = mambo_flight.accuracy.consistency:main',
            'coverage = mambo_flight.smooth.coverage:main',
            'fly = mambo_flight.fly:main',
            'plan_trajectory = mambo_flight.course.plan_course:main',
            'race = mambo_flight.race.race:main',
            'separation = mambo_flight.world.separation:main',
            'sweep = mambo_flight.sweep.command:main',
        ],
    },
)
