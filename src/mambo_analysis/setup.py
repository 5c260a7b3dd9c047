from setuptools import find_packages, setup

package_name = 'mambo_analysis'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['scenarios/*.yaml', 'report.css', 'report.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='Bag reading, import, comparison, metrics and figures, without rclpy.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'compare = mambo_analysis.compare:main',
            'drift_experiments = mambo_analysis.drift.experiments:main',
            'estimate = mambo_analysis.estimate:main',
            'fly = mambo_analysis.fly:main',
            'identify_drag = mambo_analysis.identify.drag:main',
            'identify_drift = mambo_analysis.drift.identify_drift:main',
            'identify_flow = mambo_analysis.identify.flow:main',
            'identify_inertia = mambo_analysis.identify.inertia:main',
            'identify_motor = mambo_analysis.identify.motor:main',
            'identify_sensors = mambo_analysis.identify.sensors:main',
            'identify_thrust = mambo_analysis.identify.thrust:main',
            'import_bag = mambo_analysis.import_bag:main',
            'import_crazyflie = mambo_analysis.import_crazyflie:main',
            'import_minidrone = mambo_analysis.import_minidrone:main',
            'import_motive = mambo_analysis.import_motive:main',
            'join = mambo_analysis.join:main',
            'recover = mambo_analysis.recover:main',
            'reproduce = mambo_analysis.reproduce:main',
            'sweep = mambo_analysis.sweep.command:main',
            'validate_recordings = mambo_analysis.validate:main',
        ],
    },
)
