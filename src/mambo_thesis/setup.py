from setuptools import find_packages, setup

package_name = 'mambo_thesis'

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
    description='The figures and claims of the thesis, its drift, and public recordings.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'drift_experiments = mambo_thesis.drift.experiments:main',
            'estimators = mambo_thesis.estimators.estimators:main',
            'identify_drift = mambo_thesis.drift.identify_drift:main',
            'reproduce = mambo_thesis.reproduce:main',
            'validate_recordings = mambo_thesis.recordings.validate:main',
        ],
    },
)
